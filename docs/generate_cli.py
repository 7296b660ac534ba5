"""Write docs/cli.md from the command line itself; `make docs` runs it and a test compares."""

from __future__ import annotations

from pathlib import Path

from typer.main import get_command

from hydro.cli import app

WIDTH = 100
PAGE = Path(__file__).with_name("cli.md")
INTRODUCTION = """# The command line

Written by `make docs` from the commands' own help: do not edit it by hand.

Exit codes: 0 done; 1 the data or a file is at fault; 2 wrong usage; 3 a bug in hydro; 130 interrupted. An error is one
line on stderr; `--debug` adds the traceback. Binary never goes to a terminal, tables for people never into a pipe.
"""


def page() -> str:
    """The whole page: the root's help, then every command's."""
    root = get_command(app)
    top = root.make_context("hydro", [], resilient_parsing=True, terminal_width=WIDTH, max_content_width=WIDTH)
    sections = [f"{INTRODUCTION}\n{_fenced(root.get_help(top))}"]
    for name in root.list_commands(top):
        command = root.get_command(top, name)
        context = command.make_context(
            name, [], parent=top, resilient_parsing=True, terminal_width=WIDTH, max_content_width=WIDTH
        )
        sections.append(f"## hydro {name}\n\n{_fenced(command.get_help(context))}")
    return "\n".join(sections)


def _fenced(text: str) -> str:
    lines = [line.rstrip() for line in text.strip().splitlines()]
    return "\n".join(["```text", *lines, "```", ""])


if __name__ == "__main__":
    PAGE.write_text(page())
