"""Tables for a person fit a terminal of 80 columns, and lose nothing for it."""

from __future__ import annotations

import io
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
import studies
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from terminal import fits, on_terminal

import hydro
from hydro import cli
from hydro.commands import fit
from hydro.commands.tables import print_table
from hydro.core.effects import CATALOGUE
from hydro.core.prediction.parameters import unit_at
from hydro.io.files import bundled
from hydro.report import ladder

VEHICLE = str(bundled("stonefish") / "vehicle.toml")
WORDS = st.text("abcdefgh_", min_size=1, max_size=24)
NUMBERS = st.floats(-1e6, 1e6, allow_nan=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A vehicle, a recording, its labels, a network and a study."""
    made = tmp_path_factory.mktemp("widths")
    recording = hydro.read(bundled("stonefish") / "replay90.parquet").head(600)
    shutil.copy(VEHICLE, made / "vehicle.toml")
    hydro.write(recording, made / "raw.parquet", "raw", vehicle_file=VEHICLE)
    for line in (
        f"labels {made}/raw.parquet -o {made}/labels.parquet",
        f"split {made}/labels.parquet -o {made}/split.parquet",
        f"train {made}/split.parquet --model mlp --epochs 1 -o {made}/mlp.parquet",
    ):
        assert cli.main(line.split()) == 0
    return studies.write(made)


@pytest.mark.parametrize(
    "line",
    [
        "check vehicle.toml raw.parquet",
        "compare vehicle.toml raw.parquet",
        "evaluate mlp.parquet --labels split.parquet --part all --by speed",
        "replay raw.parquet --model mlp.parquet --piece 5 --conditioning paper",
        "show comparison-0.parquet",
        "show diagnosis-0.parquet",
        "show ladder.parquet",
        "show split.parquet",
        "show mlp.parquet",
        "report . -o report.html",
        "effects",
        *(f"effects {name}" for name in CATALOGUE),
    ],
)
def test_commands_keep_to_the_terminal(
    line: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    text = on_terminal(line.split(), 80, monkeypatch)
    if line.startswith("effects "):  # the table for a vehicle file is to be copied: it keeps its lines
        text = text.partition("in a vehicle file")[0]
    assert fits(text), text


def test_fitted_parameters_keep_to_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = []
    for name, effect in CATALOGUE.items():
        for one in effect.parameters:
            unit = unit_at(one, (0,) * len(one.shape))
            rows.append((f"{name}.{one.name}[5, 5]", -1.234567e-5, 1.2345e-6, unit, False))
    frame = pl.DataFrame(rows, ["parameter", "value", "error", "unit", "determined"], orient="row")
    monkeypatch.setenv("COLUMNS", "80")
    fit._show(SimpleNamespace(method="output", chi2=1.0, frame=lambda: frame))
    text = capsys.readouterr().err
    assert all(row[0] in text for row in rows)
    assert fits(text), text


def printed(frame: pl.DataFrame, width: int) -> str:
    shown = io.StringIO()
    print_table(frame, "Title", Console(file=shown, width=width, highlight=False, markup=False))
    return shown.getvalue()


def test_the_ladder_of_a_study_and_flown_policies_keep_to_it() -> None:
    every = studies.ladder()
    for dataset in every["dataset"].unique():
        assert fits(printed(ladder.errors(every, dataset), 80))
    wide = pl.DataFrame(
        {
            "condition": ["structured-dr"],
            "seed": [3],
            "steps": [2_000_000],
            "plant": ["student"],
            **{name: [np.pi] for name in ("success", "success_low", "success_high", "collision", "energy")},
        }
    )
    text = printed(wide, 80)
    assert fits(text)
    assert text.count("structured-dr") == 2, "the second table says of whom it is"


@given(
    names=st.lists(WORDS, min_size=1, max_size=9, unique=True),
    keys=st.lists(WORDS, min_size=1, max_size=3),
    data=st.data(),
)
def test_every_cell_is_there_once_and_whole(names: list[str], keys: list[str], data: st.DataObject) -> None:
    columns = {"key": keys}
    columns |= {name: [data.draw(NUMBERS) for _ in keys] for name in names if name != "key"}
    narrow, wide = (printed(pl.DataFrame(columns), width) for width in (80, 1000))
    assert fits(narrow), narrow
    cells = re.findall(r"[^\s─]+", wide)
    again = re.findall(r"[^\s─]+", narrow)
    assert set(cells) == set(again)
    assert fits(wide, 1000)
    assert len(again) - len(cells) == (narrow.count("key ") - 1) * (1 + len(keys))
