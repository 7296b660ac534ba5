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
    assert "missing: ocean_current" in told
    assert "missing: thruster_gain" in told
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
    names = r"\d \w+.*?|noise alone|zero velocity|constant velocity|least squares"
    rows = re.findall(rf"^({names}) +((?:[\d.]+ *)+)$", readme, re.MULTILINE)
    assert len(rows) == 7
    for name, numbers in rows:
        found = re.search(rf"^{name} +((?:[\d.]+ *)+)$", held_out, re.MULTILINE)
        assert found, f"explain prints no row {name} of the README"
        assert [*map(float, found[1].split())] == pytest.approx([*map(float, numbers.split())], rel=0.05), (
            name
        )
    values = re.findall(r"^ +(\w+: (?:no\. \d: )?)(-?[\d.]+) ± ", readme, re.MULTILINE)
    assert len(values) == 3
    for name, value in values:
        found = re.search(rf"^ +{re.escape(name)}(-?[\d.]+) ± ", held_out, re.MULTILINE)
        assert found, f"explain prints no value {name} of the README"
        assert float(found[1]) == pytest.approx(float(value), rel=0.02), name
    errors = table.read(f"{folder.name}/errors.parquet", "metrics").frame.filter(metric="rmse")
    for axis in "uvwpqr":
        error = dict(errors.filter(axis=axis).select("variant", "value").rows())
        assert error["MJ4"] < 0.2 * error["MJ0+M_A"] < 0.2 * error["MJ0"], "learned water beats none"
