"""Help of a command on one screen: examples that can be pasted, and options in named groups.

A docstring has a summary, a paragraph and examples, which are indented.  What follows a line `Details:`
appears only on the page of the documentation.
"""

from __future__ import annotations

import re
from typing import Any

from typer.core import TyperCommand

from hydro.report.following import pasted

WIDTH = 78
"""Maximum width of an example: 80 columns less the indentation of the help."""
DETAILS = "Details:"
"""Paragraph after which the text appears only on the page of the documentation."""
KEPT = "\b\n"
"""Marker of Click for a paragraph whose line breaks are kept."""
PLAIN_NUMBER = re.compile(r"<(int|float)( range)?>")
"""Pattern of Typer's name for the value of a numeric option."""
ADVANCED, CLUSTER, NEXT_RUN = "Advanced", "Cluster", "Next run"
"""Names of the groups of rarely used options."""


def paragraphs(text: str) -> list[str]:
    """Return the paragraphs of a docstring; those of examples are indented.

    A paragraph loses the character by which Click keeps its line breaks.
    """
    return [one.removeprefix(KEPT) for one in text.split("\n\n")]


def short(text: str) -> str:
    """Return the part of a command's docstring that its help shows, without the details.

    Args:
        text: The docstring, its common indentation removed.
    """
    shown = text.partition(f"\n\n{DETAILS}\n")[0]
    kept = [f"{KEPT}{one}" if one.startswith("    ") else one for one in shown.split("\n\n")]
    return "\n\n".join(kept)


class Pasted:
    """Mixin for a command or group whose help shows examples with their line breaks."""

    help: str | None

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        """Write the summary, the paragraph and the examples of the command's docstring.

        Args:
            ctx: Context of the parser.
            formatter: Formatter of the help text; receives them.
        """
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text(short(self.help or ""))


class Screen(Pasted, TyperCommand):
    """Mixin for a command whose help fits one screen."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the words of the command's usage line: required arguments as they are, others in brackets.

        Args:
            ctx: Context of the parser.
        """
        arguments = [one for one in self.get_params(ctx) if one.param_type_name == "argument"]
        names = [one.metavar or (one.name or "").upper() for one in arguments]
        return [
            self.options_metavar or "",
            *(name if one.required else f"[{name}]" for name, one in zip(names, arguments, strict=True)),
        ]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the command's arguments and options, and then the groups of rarely used options.

        Args:
            ctx: Context of the parser.
            formatter: Formatter of the help text; receives the sections.
        """
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for one in self.get_params(ctx):
            if (record := one.get_help_record(ctx)) is None:
                continue
            if one.param_type_name == "argument":
                sections["Arguments"].append((one.metavar or record[0], getattr(one, "help", "") or ""))
            else:
                panel = getattr(one, "rich_help_panel", None) or "Options"
                sections.setdefault(panel, []).append((PLAIN_NUMBER.sub("N", record[0]), record[1]))
        for title, rows in sections.items():
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


def example(line: str) -> str:
    """Return the paragraph of a help with an example: lines of a screen that a shell reads as one command.

    Args:
        line: The command.
    """
    return "\n".join([KEPT + "Example:", *pasted(re.split(r"\s+", line), WIDTH, indent="  ")])
