"""The table "Where do I change X?" of CONTRIBUTING.md names files that are there."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text()
PATH = re.compile(r"(?:hydro|tests|schemas|docs|benchmarks|datasets)(?:/[\w.]+)*/?")


def rows(section: str) -> list[list[str]]:
    """Cells of a section's table, without its head."""
    part = TEXT.split(f"## {section}\n")[1].split("\n## ")[0]
    lines = [line for line in part.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def test_every_path_of_the_table_exists() -> None:
    table = rows("Where do I change X?")
    assert len(table) >= 12
    for question, here, test in table:
        for cell in (here, test):
            named = {*re.findall(r"`([^`]+/[^`]*)`", cell), *re.findall(r"\]\(([^)]+)\)", cell)}
            for path in named:
                assert (ROOT / path).exists(), f"{question}: {path}"
        assert re.search(r"tests/", test), question


def test_a_file_named_without_its_folder_is_in_the_folder_beside_it() -> None:
    (plot,) = (here for question, here, _ in rows("Where do I change X?") if question.startswith("a plot"))
    for name in re.findall(r"`([\w.]+)`", plot):
        assert (ROOT / "hydro" / "report" / name).exists(), name


def test_the_architecture_lists_every_package() -> None:
    named = {path for row in rows("Architecture") for path in PATH.findall(row[0])}
    for folder in [*(ROOT / "hydro").iterdir(), *(ROOT / "hydro" / "core").iterdir()]:
        if (folder / "__init__.py").exists():
            assert str(folder.relative_to(ROOT)) in named
    for path in named:
        assert (ROOT / path).exists(), path
