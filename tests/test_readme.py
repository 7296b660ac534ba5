"""What the README tells a newcomer to type exists: its commands, options, targets, files and functions."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import polars as pl
import pytest

import hydro
from hydro import cli

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "datasets").glob("*.md")])
README = (ROOT / "README.md").read_text()


def code(text: str) -> str:
    """The indented blocks and fences of a page."""
    fenced = re.findall(r"```(?:\w*)\n(.*?)```", text, re.DOTALL)
    return "\n".join([*fenced, *re.findall(r"^    (.*)$", text, re.MULTILINE)])


def command_lines() -> list[list[str]]:
    """Every `hydro COMMAND ...` of all pages, pipes taken apart."""
    lines = []
    for page in PAGES:
        for line in code(page.read_text()).replace("\\\n", " ").splitlines():
            for part in line.split("#")[0].split("|"):
                if part.strip().startswith("hydro "):
                    lines.append(shlex.split(part))
    return lines


def test_commands_and_options_exist(capsys: pytest.CaptureFixture[str]) -> None:
    lines = command_lines()
    assert len(lines) > 5
    families = {family.NAME for family in cli.FAMILIES}
    for _, command, *rest in lines:
        named = [command, rest.pop(0)] if command in families else [command]
        assert cli.main([*named, "--help"]) == 0, command
        text = capsys.readouterr().out
        for option in (word for word in rest if word.startswith("-") and word != "-"):
            assert re.search(rf"(?<![\w-]){option}\b", text), f"hydro {command} has no {option}"


def test_targets_exist() -> None:
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for page in PAGES:
        assert set(re.findall(r"\bmake (\w+)", code(page.read_text()))) <= targets, page.name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
        assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_functions_exist() -> None:
    named = set(re.findall(r"\bhydro\.(\w+)\(", README))
    assert named >= {"read", "labels", "split", "train", "replay"}
    assert named <= set(hydro.__all__)


def test_the_query_runs(tmp_path: Path, datasets: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    raw = hydro.read(datasets / "stonefish" / "replay90.parquet", "raw")
    labels = hydro.labels(raw, hydro.vehicle(datasets / "stonefish" / "vehicle.toml"))
    hydro.write(labels, tmp_path / "labels.parquet", "labels")
    monkeypatch.chdir(tmp_path)
    query = next(
        block for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if "scan_parquet" in block
    )
    printed: list[pl.DataFrame] = []
    exec(query, {"print": printed.append})
    assert printed[0].columns == ["session", "X_res", "Y_res", "Z_res"]
    assert printed[0].height == 1
