"""`--json`: what a program reads on stdout, and nothing else there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from recordings import WEAK, damped, moved, noisy

import hydro
from hydro import cli
from hydro.commands.as_json import print_json
from hydro.io.files import bundled

VEHICLE = str(bundled("stonefish") / "vehicle.toml")


@pytest.fixture
def short(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The beginning of a recording."""
    monkeypatch.chdir(tmp_path)
    whole = hydro.read(bundled("stonefish") / "replay90.parquet")
    hydro.write(whole.head(2000), "raw.parquet", "raw")
    return "raw.parquet"


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert cli.main(list(arguments)) == 0
    said = capsys.readouterr()
    found: dict[str, Any] = json.loads(said.out)
    return found


def test_compare(short: str, capsys: pytest.CaptureFixture[str]) -> None:
    found = printed(capsys, "compare", VEHICLE, short, "--json", "-o", "comparison.parquet")
    table = hydro.read("comparison.parquet")
    assert [row["rmse"] for row in found["comparison"]] == table["rmse"].fill_nan(None).to_list()
    assert printed(capsys, "compare", VEHICLE, short, "--json") == found, "without -o no table goes to stdout"


def test_diagnose(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hydro.write_vehicle(damped(), tmp_path / "vehicle.toml")
    raw = noisy(moved(damped(WEAK), rows=1700), 0)
    hydro.write(raw, tmp_path / "raw.parquet", "raw")
    found = printed(capsys, "diagnose", f"{tmp_path}/vehicle.toml", f"{tmp_path}/raw.parquet", "--json")
    assert list(found["chi2"]) == ["given", "own_effects", "found"]
    named = found["findings"]
    assert named
    assert all(isinstance(row["parameters"], dict) for row in named)
    assert any(row["parameters"] for row in named)


def test_numbers_that_are_none_become_null(capsys: pytest.CaptureFixture[str]) -> None:
    table = pl.DataFrame({"a": [1.5, float("nan"), None], "parameters": ["{ g = [0.5, 1] }", "", None]})
    print_json(table=table, far=float("inf"))
    found = json.loads(capsys.readouterr().out)
    assert found["far"] is None
    assert [row["a"] for row in found["table"]] == [1.5, None, None]
    assert [row["parameters"] for row in found["table"]] == [{"g": [0.5, 1]}, {}, {}]
