"""Command lines as a reader finds them: in help texts, in messages and in answers."""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hydro import cli

PACKAGE = Path(cli.__file__).parent
QUOTED = re.compile(r"`(hydro [^`]+)`")


def every_command(group: Any = None, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield every command with its name, those of families as `("rl", "train")`."""
    for name, command in (group or cli._parser()).commands.items():
        if hasattr(command, "commands"):
            yield from every_command(command, (*path, name))
        else:
            yield (*path, name), command


COMMANDS = dict(every_command())
FAMILIES = {path[:1] for path in COMMANDS if len(path) > 1}


def pasted_from(text: str) -> list[str]:
    """The command lines of a screen: continued lines joined, as a shell reads them."""
    lines = iter(text.splitlines())
    found = []
    for line in lines:
        if not line.strip().startswith("hydro "):
            continue
        whole = line.strip()
        while whole.endswith(("\\", "|")):
            whole = f"{whole.removesuffix(chr(92)).rstrip()} {next(lines).strip()}"
        found.append(whole)
    return found


def parts(line: str) -> list[list[str]]:
    """The words of each command of a line, those of a pipe apart."""
    words, found = shlex.split(line), [list[str]()]
    for word in words:
        if word == "|":
            found.append([])
        else:
            found[-1].append(word)
    return found


def parse(line: str) -> None:
    """Parse every command of a line as the program would, without running it.

    Raises:
        AssertionError: There is no such command.
        Exception: The parser refuses the line.
    """
    for hydro, *words in parts(line):
        assert hydro == "hydro", line
        path = tuple(words[:2]) if tuple(words[:2]) in COMMANDS else tuple(words[:1])
        assert path in COMMANDS, line
        COMMANDS[path].make_context(" ".join(path), words[len(path) :])


def known_options(line: str) -> None:
    """Assert that a command and its options exist, of a line with words to fill in."""
    for _, *words in parts(line):
        path = tuple(words[:2]) if tuple(words[:2]) in COMMANDS else tuple(words[:1])
        if path == ("--help",) or path == ("COMMAND",) or path in FAMILIES:
            continue
        assert path in COMMANDS, line
        known = {name for one in COMMANDS[path].params for name in (*one.opts, *one.secondary_opts)} | {
            "--help"
        }
        assert {word for word in words if re.match(r"--?[a-z]", word)} <= known, line


def in_messages() -> Iterator[tuple[str, str]]:
    """Yield every command line in backquotes in a text of the program, with the module that says it."""
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text()
        if "`hydro" not in text:
            continue
        tree = ast.parse(text)
        within = {
            id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                text = "".join(
                    str(part.value) if isinstance(part, ast.Constant) else "WORD" for part in node.values
                )
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in within:
                text = node.value
            else:
                continue
            for line in QUOTED.findall(" ".join(text.split())):
                yield str(path.relative_to(PACKAGE)), line
