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
from hydro.io import table, vehicle

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
    assert steps[:3] == ["compare", "explain", "report"]
    assert steps[3:] == ["labels", "split", "train", "train", "evaluate", "replay"]
    assert printed.index("Predicted wrench") < printed.index("Open-loop replay") < printed.index("Written:")
    assert all(name in printed for name in ("mlp", "physfeat", "MJ0", "MJ0+M_A", "MJ1", "MJ4"))
    written = [
        Path(path)
        for path in re.findall(rf"^  ({folder.name}\S+)$", printed.split("Written:")[1], re.MULTILINE)
    ]
    report = Path(re.findall(r"for a browser: (\S+)$", printed, re.MULTILINE)[0])
    assert sorted([*written, report]) == sorted(Path(folder.name).iterdir())
    assert "thruster_gain" in report.read_text()
    for path in written:
        if path.suffix == ".png":
            assert imread(path).shape[1] > 600
        elif path.suffix == ".parquet":
            table.read(path)
    study = Path(folder.name) / "study"
    added = vehicle.read(study / "vehicle-1.toml")[0].effects("thruster_gain")[0]
    assert added["g"][2] == pytest.approx(-0.4, abs=2.0 * added["standard_error"]["g"][2])
    readme = (ROOT / "README.md").read_text()
    row = r"^  (\w+) \[(?:m|rad)/s\] +((?:[\d.]+ *)+)$"
    title = "Error 5 s ahead  as given  corrected"
    rows, found = (dict(re.findall(row, text.split(title)[1], re.MULTILINE)) for text in (readme, told))
    assert list(rows) == [*"uvwpqr", "all"]
    for axis, numbers in rows.items():
        printed_row = [*map(float, found[axis].split())]
        assert printed_row == pytest.approx([*map(float, numbers.split())], rel=0.05), axis
        assert printed_row[1] < printed_row[0], "the change lowers the error on every axis"
    corrections = r"Thruster 3 delivers \d+ % \(±\d+\)"
    assert re.findall(corrections, readme) == re.findall(corrections, told) != []
    errors = table.read(f"{folder.name}/errors.parquet", "metrics").frame.filter(metric="rmse")
    for axis in "uvwpqr":
        error = dict(errors.filter(axis=axis).select("variant", "value").rows())
        assert error["MJ4"] < 0.2 * error["MJ0+M_A"] < 0.2 * error["MJ0"], "learned water beats none"
