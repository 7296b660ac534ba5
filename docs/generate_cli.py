"""Write docs/cli.md from the help of the commands; `make docs` runs it and a test compares."""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

from typer.models import ArgumentInfo

from hydro.cli import FAMILIES, SECTIONS
from hydro.commands.help import DETAILS, paragraphs

PAGE = Path(__file__).with_name("cli.md")
INTRODUCTION = """# The command line

`make docs` writes this page from the help texts of the commands: do not edit it by hand.

Commands read and write vehicle files (TOML) and tables (Parquet). A missing input or `-` is stdin; a missing
`-o` or `-` is stdout. A pipe gives the same bytes as files:

    hydro labels raw.parquet | hydro split | hydro train --model physfeat -o model.parquet

Binary data never go to a terminal. Readable tables and progress never go into a pipe. An error is one line on
stderr, which says what happened, where, and what to do. `--debug` adds the traceback.

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | error in the data or in a file |
| 2 | wrong usage of the command |
| 3 | a bug in hydro; or `hydro track` found a new change |
| 130 | interrupted |
"""


def page() -> str:
    """Return the whole page: the introduction, the commands by section, then each command."""
    contents, described = [], []
    for title, modules in SECTIONS.items():
        commands = {command: example for module in modules for command, example in module.COMMANDS.items()}
        contents += [f"**{title}**\n", *map(_entry, commands), ""]
        described += [_section(command, example) for command, example in commands.items()]
    return "\n".join([INTRODUCTION, *contents, *described])


def _entry(command: Callable[..., Any]) -> str:
    """Return the line of one command in the list of contents."""
    title = _title(command)
    return f"- [`{title}`](#{title.replace(' ', '-')}): {_text(command)[0]}"


def _section(command: Callable[..., Any], example: str) -> str:
    """Return the section of a command: description, example, arguments and options."""
    signature, hints = inspect.signature(command), get_type_hints(command, include_extras=True)
    rows = [
        _row(name, hints[name], parameter.default)
        for name, parameter in signature.parameters.items()
        if get_args(hints[name]) and not getattr(get_args(hints[name])[1], "hidden", False)
    ]
    text = "\n\n".join(_text(command))
    table = "\n".join(["| argument or option | meaning |", "|---|---|", *rows])
    return f"## {_title(command)}\n\n{text}\n\n    {example}\n\n{table}\n"


def _row(name: str, annotation: Any, default: Any) -> str:
    """Return the table row of an argument or option: name, choices, meaning and default."""
    value, info, *_ = get_args(annotation)
    if isinstance(info, ArgumentInfo):
        return f"| `{info.metavar}` | {info.help} |"
    flags = [info.default, *info.param_decls] if isinstance(info.default, str) else list(info.param_decls)
    spelled = ", ".join(sorted(flags, key=len)) or f"--{name.replace('_', '-')}"
    if value is not bool:
        literals = [kind for kind in (value, *get_args(value)) if get_origin(kind) is Literal]
        choices = "\\|".join(get_args(literals[0])) if literals else (info.metavar or "").replace("|", "\\|")
        spelled += f" {choices or _bare(value).upper()}"
    return f"| `{spelled}` | {info.help}{_default(default)} |"


def _default(default: Any) -> str:
    """Return the default of an option in words, unless its help states it."""
    if default is inspect.Parameter.empty:
        return " Required."
    return "" if default is None or default in ("", "-") else f" Default: {default}."


def _bare(value: Any) -> str:
    """Return the name of a type, without None for an optional one."""
    plain = [kind for kind in get_args(value) if kind is not types.NoneType] or [value]
    return str(plain[0].__name__)


def _title(command: Callable[..., Any]) -> str:
    family = next((f"{one.NAME} " for one in FAMILIES if command in one.COMMANDS), "")
    return f"hydro {family}{command.__name__.removesuffix('_')}"


def _text(command: Callable[..., Any]) -> list[str]:
    """Return the paragraphs of a command's docstring, each on one line; examples keep their lines."""
    return [
        one if one.startswith("    ") else " ".join(one.split())
        for one in paragraphs(inspect.getdoc(command) or "")
        if one != DETAILS
    ]


if __name__ == "__main__":
    PAGE.write_text(page())
