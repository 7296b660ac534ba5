"""The demonstration runs on bundled data alone, leaves what it says it wrote, and prints what the README has.

`HYDRO_DEMO` names a folder where `make demo` has run already, with what it printed in `demo.log` beside it.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from matplotlib.image import imread

from hydro import cli
from hydro.io import table

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.slow
def test_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    if there := os.environ.get("HYDRO_DEMO"):
        folder = Path(there).resolve()
        monkeypatch.chdir(folder.parent)
        printed = told = folder.with_name("demo.log").read_text()
    else:
        folder = tmp_path / "out"
        monkeypatch.chdir(tmp_path)
        assert cli.main(["demo", "out", "--epochs", "3"]) == 0
        printed, told = capsys.readouterr()  # findings are told beside the files that hold them
    steps = re.findall(r"^\$ hydro (\w+)", printed, re.MULTILINE)
    assert steps[:4] == ["compare", "diagnose", "explain", "report"]
    assert steps[4:] == ["labels", "split", "train", "train", "evaluate", "replay"]
    assert "Ocean current: certain" in told
    assert "Thruster gain: certain" in told
    assert printed.index("Predicted wrench") < printed.index("Open-loop replay") < printed.index("Written:")
    assert all(name in printed for name in ("mlp", "physfeat", "MJ0", "MJ0+M_A", "MJ1", "MJ4"))
    written = [
        Path(path)
        for path in re.findall(rf"^  ({folder.name}\S+)$", printed.split("Written:")[1], re.MULTILINE)
    ]
    report = Path(re.findall(r"for a browser: (\S+)$", printed, re.MULTILINE)[0])
    assert sorted([*written, report]) == sorted(Path(folder.name).iterdir())
    assert "ocean_current" in report.read_text()
    for path in written:
        if path.suffix == ".png":
            assert imread(path).shape[1] > 600
        elif path.suffix == ".parquet":
            table.read(path)
    ladder = table.read(f"{folder.name}/study/ladder.parquet", "ladder").frame.filter(axis="all", horizon=5.0)
    assert set(ladder["effect"]) == {"", "ocean_current", "thruster_gain"}
    for dataset in ("fit", "holdout"):
        rows = ladder.filter(dataset=dataset).sort("step")
        assert (rows["rmse"].diff().drop_nulls() < 0.0).all(), "every step lowers the error"
        assert rows["rmse"][-1] < 1.1 * rows["noise_floor"][-1]
    assert Path(f"{folder.name}/study/vehicle-2.toml").exists(), "the README names it"
    held_out, readme = told.split("held-out data", 1)[1], (ROOT / "README.md").read_text()
    row = r"^  (\w+) \[(?:m|rad)/s\] +((?:[\d.]+ *)+)$"
    rows, found = re.findall(row, readme, re.MULTILINE), dict(re.findall(row, held_out, re.MULTILINE))
    assert [axis for axis, _ in rows] == [*"uvwpqr", "all"]
    for axis, numbers in rows:
        assert [*map(float, found[axis].split())] == pytest.approx(
            [*map(float, numbers.split())], rel=0.05
        ), f"explain prints another row {axis} than the README"
    for sentence in ("Thruster 5 delivers 70 % of its modelled thrust", "flows toward 323° (NW)"):
        assert sentence in " ".join(readme.split())
        assert sentence in " ".join(held_out.split())
    errors = table.read(f"{folder.name}/errors.parquet", "metrics").frame.filter(metric="rmse")
    for axis in "uvwpqr":
        error = dict(errors.filter(axis=axis).select("variant", "value").rows())
        assert error["MJ4"] < 0.2 * error["MJ0+M_A"] < 0.2 * error["MJ0"], "learned water beats none"
