"""The examples of docs/api.md run, in their order, on short pieces of the recordings that they name."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import forked
import pytest

import hydro

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "api.md").read_text()
HIDDEN = ROOT / "datasets" / "hidden"


def examples(title: str) -> str:
    """All Python of one section of the page."""
    section = PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]
    found = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    assert found
    return "\n".join(found)


@pytest.mark.slow
def test_a_missing_effect_is_found_and_added(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    short = tmp_path / "datasets" / "hidden"
    short.mkdir(parents=True)
    (short / "vehicle.toml").write_bytes((HIDDEN / "vehicle.toml").read_bytes())
    for name in ("measured", "heldout"):
        whole = hydro.read(HIDDEN / f"{name}.parquet")
        hydro.write(whole.head(1000), short / f"{name}.parquet", "raw")
    code = examples("Example: find a missing effect")
    script = tmp_path / "page.py"
    script.write_text(
        f"import matplotlib\n\nmatplotlib.use('Agg')\n{code}\nprint(stated, worst, sep='\\n')\n"
    )
    done = subprocess.run(
        [forked.python(), script], cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert "Thruster 5 delivers 70 %" in done.stdout
    assert "thruster_gain" in done.stdout
    assert "Step 1, thruster gain" in done.stdout
    assert hydro.vehicle(tmp_path / "runs" / "better.toml").effects("thruster_gain")
    assert (tmp_path / "runs" / "errors.png").stat().st_size > 5000


def test_every_result_of_the_page_is_there() -> None:
    rows = re.findall(r"^\| \[(\w+)\]\(#hydro\.(\w+)\) \| `hydro\.(\w+)`", PAGE, re.MULTILINE)
    assert len(rows) == 5
    for name, anchor, function in rows:
        assert name == anchor
        assert callable(getattr(hydro, function))
        for member in ("headline", "summary", "plot", "to_json"):
            assert hasattr(getattr(hydro, name), member)
            assert f"`{member}" in PAGE
