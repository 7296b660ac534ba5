"""The demonstration runs on bundled data alone and leaves everything that it says it wrote."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from matplotlib.image import imread

from hydro import cli
from hydro.io import table


@pytest.mark.slow
def test_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["demo", "out", "--epochs", "3"]) == 0
    printed = capsys.readouterr().out
    steps = re.findall(r"^\$ hydro (\w+)", printed, re.MULTILINE)
    assert steps == ["labels", "split", "train", "train", "evaluate", "replay"]
    assert printed.index("Predicted wrench") < printed.index("Open-loop replay") < printed.index("Written:")
    assert all(name in printed for name in ("mlp", "physfeat", "MJ0", "MJ0+M_A", "MJ1", "MJ4"))
    written = [Path(line.strip()) for line in printed.split("Written:")[1].splitlines() if line.strip()]
    assert sorted(path.name for path in written) == sorted(path.name for path in Path("out").iterdir())
    for path in written:
        if path.suffix == ".png":
            assert imread(path).shape[1] > 600
        else:
            table.read(path)
    errors = table.read("out/errors.parquet", "metrics").frame.filter(metric="rmse")
    for axis in "uvwpqr":
        error = dict(errors.filter(axis=axis).select("variant", "value").rows())
        assert error["MJ4"] < 0.2 * error["MJ0+M_A"] < 0.2 * error["MJ0"], "learned water beats none"
