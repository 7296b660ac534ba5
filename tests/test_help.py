"""Help of every command: one screen, and examples that can be pasted."""

from __future__ import annotations

import inspect

import command_lines
import pytest
from command_lines import COMMANDS, known_options, parse, pasted_from

from hydro import cli
from hydro.commands.help import DETAILS, short

LINES, COLUMNS = 50, 80
NAMES = [(), ("rl",), ("study",), ("vehicle",), *COMMANDS]


def help_of(
    path: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> str:
    monkeypatch.setenv("COLUMNS", str(COLUMNS))
    assert cli.main([*path, "--help"]) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("path", NAMES, ids=" ".join)
def test_it_fits_one_screen(path, monkeypatch, capsys) -> None:
    lines = help_of(path, monkeypatch, capsys).splitlines()
    assert len(lines) <= LINES
    assert max(map(len, lines)) <= COLUMNS


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_its_examples_can_be_pasted(path, monkeypatch, capsys) -> None:
    """Those of the screen keep their lines; those that the page of the documentation adds parse as well."""
    text = help_of(path, monkeypatch, capsys)
    examples = pasted_from(text)
    assert examples, "an example at the end"
    whole = inspect.getdoc(COMMANDS[path].callback) or ""
    for line in {*examples, *pasted_from(whole)}:
        parse(line)
    assert pasted_from(short(whole)) == examples[:-1]


def test_every_option_stands_in_one_group(monkeypatch, capsys) -> None:
    text = help_of(("diagnose",), monkeypatch, capsys)
    titles = ["Arguments:", "Options:", "Advanced:", "Next run:", "Cluster:"]
    places = [text.index(f"\n{title}\n") for title in titles]
    assert places == sorted(places)
    shown = [one for one in COMMANDS["diagnose",].params if not getattr(one, "hidden", False)]
    for option in (name for one in shown for name in one.opts if name.startswith("--")):
        assert text[places[1] :].count(f"  {option} ") + text.count(f", {option} ") == 1, option
    assert DETAILS not in text


@pytest.mark.parametrize(("module", "line"), sorted(set(command_lines.in_messages())))
def test_a_command_that_a_message_names_exists(module, line) -> None:
    known_options(line)
