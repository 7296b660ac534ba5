"""Future work of the paper: errors of every kind of model are summed alike, and the tables state them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from benchmarks.future_work import recordings, tables
from benchmarks.future_work.predictions import MOST_ERROR, SPACE, Windows
from benchmarks.future_work.study import AHEAD, BARE, LEAST_SQUARES, SCHEMA, SEQUENCE, WRENCHES, of_blocks
from benchmarks.work import Results
from hydro.core.columns import VELOCITY, WRENCH

BLOCKS, NUMBER = 12, 50
SIZES = {(LEAST_SQUARES, -1): 2.0, (BARE, -1): 4.0, ("mlp", 0): 1.0, ("mlp", 1): 3.0}
"""Root mean square error of each method and seed; it is the same in all blocks and on all axes."""


def of_method(part: str, case: str, method: str, seed: int, size: float) -> list[dict]:
    squares = np.full((BLOCKS, 6), size**2 * NUMBER)
    numbers = np.full((BLOCKS, 6), NUMBER)
    rows = [*of_blocks(AHEAD, VELOCITY, squares, numbers)]
    if part != "recorded":
        rows += of_blocks(SEQUENCE, VELOCITY, squares[:1], numbers[:1])
    if method != LEAST_SQUARES:
        rows += of_blocks(WRENCHES, WRENCH, squares, numbers, np.sqrt(squares * NUMBER))
    return [{"part": part, "case": case, "method": method, "seed": seed, "cpu": 1.0} | row for row in rows]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> pl.DataFrame:
    """Errors of four trainings and models in three cases, added one by one as the study does."""
    path = tmp_path_factory.mktemp("future") / "errors.parquet"
    for part, case in (("memory", "memory of 1 s"), ("vehicles", "auv151"), ("recorded", "pool")):
        for (method, seed), size in SIZES.items():
            Results(path, SCHEMA).add(*of_method(part, case, method, seed, size))
    return pl.read_parquet(path)


def test_errors_are_means_over_seeds_with_intervals_over_blocks(results: pl.DataFrame) -> None:
    made = tables.memory(results)
    assert [row["water"] for row in made] == ["no memory"] * 3 + ["memory of 1 s"] * 3
    rows = {row["model"]: row for row in made[3:]}
    assert list(rows) == [LEAST_SQUARES, BARE, "mlp"]
    assert rows[BARE]["5 s, m/s"] == "4 [4 to 4]"
    middle = f"{np.sqrt((1.0 + 9.0) / 2.0):.3g}"
    assert rows["mlp"]["5 s, m/s"] == f"{middle} [{middle} to {middle}]"
    assert rows["mlp"]["90 s, m/s (seeds)"] == f"{middle} (1 to 3)"
    assert rows[BARE]["5 s, m/s, relative to mlp"] == "1.79 [1.79 to 1.79]"
    assert rows["mlp"]["5 s, m/s, relative to mlp"] == ""
    assert rows[LEAST_SQUARES]["wrench, N and N m"] == ""


def test_an_interval_widens_with_the_differences_of_blocks(results: pl.DataFrame) -> None:
    later = pl.when(pl.col("block") < BLOCKS // 2).then(0.0).otherwise(2.0)
    errors = tables.Errors(results.filter(part="memory").with_columns(pl.col("squares") * later))
    ends = errors.error(BARE, AHEAD, ["u"]).split("[")[1].rstrip("]")
    low, high = map(float, ends.split(" to "))
    assert low < 3.5 < 4.5 < high
    assert errors.error(BARE, AHEAD, ["u"]).startswith("4 ")


def test_numbers_have_no_exponent() -> None:
    assert [tables.rounded(number, 2) for number in (104.2, 0.01234, 2.0)] == ["100", "0.012", "2"]


def test_the_paper_s_tables_have_every_model_that_they_can(results: pl.DataFrame) -> None:
    assert [row["model"] for row in tables.wrenches(results)] == [BARE, "mlp"]
    assert tables.wrenches(results)[0]["MAE"] == "4"
    assert [row["u"] for row in tables.replays(results)] == ["2", "4", "2.2 (1 to 3)"]
    real = tables.recorded(results)
    assert real[1]["r relative to least squares"] == "2.00 [2.00 to 2.00]"


def test_predictions_are_apart_and_a_divergence_counts() -> None:
    raw = pl.DataFrame(
        {"session": ["a"] * 700 + ["b"] * 300, "t": [*np.arange(700) * 0.02, *np.arange(300) * 0.02]}
    )
    truth, seen = np.zeros((1000, 6)), np.ones((1000, 6), bool)
    seen[:, 5] = False
    windows = Windows.of(raw, truth, seen)
    assert windows.rows[:, 0].tolist() == [0, 251 + round(SPACE / 0.02), 700]
    predicted = np.full((3, 251, 6), 2.0)
    predicted[1, 200:] = np.nan
    squares, numbers = windows.errors(predicted)
    assert squares[0].tolist() == [4.0 * 250] * 5 + [0.0]
    assert squares[1, 0] == 4.0 * 199 + MOST_ERROR**2 * 51
    assert numbers[0].tolist() == [250] * 5 + [0]


def test_a_memory_adds_half_of_the_hull_s_added_mass_to_slow_motion() -> None:
    vehicle = recordings.known("bluerov2_heavy")
    quick, slow = (recordings.memory(vehicle, decay) for decay in recordings.DECAY.values())
    mass = np.array(quick["K"][0]) / quick["rates"][0]
    np.testing.assert_allclose(mass, np.array(slow["K"][0]) / slow["rates"][0])
    assert mass[0] == pytest.approx(0.5 * 26.58, rel=1e-3)


def test_every_case_has_a_network_s_baselines_and_a_missing_recording_is_told(tmp_path: Path) -> None:
    assert [case.name for case in recordings.cases("vehicles")] == list(recordings.VEHICLES)
    assert recordings.WITH_MEMORY in recordings.cases("memory")[0].fits
    with pytest.raises(SystemExit, match="needs the folder"):
        recordings.cases("recorded")
    with pytest.raises(SystemExit, match=r"has no fit\.csv: give a folder with"):
        recordings.cases("recorded", tmp_path)
