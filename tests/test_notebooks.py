"""The notebooks of the documentation run from their first cell to the last, and are kept without outputs."""

from __future__ import annotations

import json
import subprocess
from importlib.util import find_spec
from pathlib import Path

import forked
import pytest

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
NEEDED = {"queries": ("duckdb", "pandas")}
"""Libraries that hydro itself does without."""


def code(notebook: Path) -> str:
    """Its cells of code, one after the other."""
    cells = json.loads(notebook.read_text())["cells"]
    return "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")


def test_there_are_four_and_a_page_names_them() -> None:
    page = (ROOT / "docs" / "notebooks.md").read_text()
    assert len(NOTEBOOKS) == 4
    assert all(f"notebooks/{one.name}" in page for one in NOTEBOOKS)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs(notebook: Path, tmp_path: Path) -> None:
    for library in NEEDED.get(notebook.stem, ()):
        if find_spec(library) is None:
            pytest.skip(f"{library} is not installed")
    (tmp_path / "datasets").symlink_to(ROOT / "datasets")
    (tmp_path / "runs").mkdir()
    script = tmp_path / "cells.py"
    script.write_text(f"import matplotlib\n\nmatplotlib.use('Agg')\n{code(notebook)}\n")
    done = subprocess.run(
        [forked.python(), script], cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_kept_without_outputs(notebook: Path) -> None:
    read = json.loads(notebook.read_text())
    assert (read["nbformat"], read["nbformat_minor"]) == (4, 5)
    cells = [cell for cell in read["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    assert len({cell["id"] for cell in read["cells"]}) == len(read["cells"])
