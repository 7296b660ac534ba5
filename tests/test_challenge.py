"""Hidden Effect Challenge: sealed truths, scores, the example of an entry, and symmetries of recordings."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from benchmarks.challenge import layout, make, score, seal, sources
from benchmarks.challenge.__main__ import ordered
from benchmarks.challenge.baselines import as_given, held_of, run, table_of
from benchmarks.challenge.board import board, of_all
from hydro.core.simulation.simulate import simulate
from hydro.io import table
from hydro.io import vehicle as vehicles
from hydro.io.files import bundled

KEY = bytes(32)
VEHICLE = (bundled("vehicles") / "auv151.toml").read_text()


def flown(change: str = "") -> pl.DataFrame:
    """Fly the vehicle, with a change of its file, by the commands of a bundled recording."""
    raw = table.read(bundled("stonefish") / "replay90.parquet").frame.head(1200)
    return simulate(vehicles.parse(VEHICLE + change), raw.cast({pl.Float32: pl.Float64}))


@pytest.fixture(scope="module")
def edition(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of an edition of one case: a weak thruster in the simulator of hydro."""
    folder = tmp_path_factory.mktemp("edition")
    hidden = {"g": [0.0, 0.0, -0.4, 0.0, 0.0, 0.0, 0.0, 0.0]}
    after = flown(f'\n[[effect]]\nname = "thruster_gain"\ng = {hidden["g"]}\n')
    source = sources.Source(
        VEHICLE,
        after.head(600),
        flown().head(600),
        after.with_columns(session=pl.lit("later")),
        ("thruster_gain",),
        values={"thruster_gain": hidden},
    )
    number = sources.Number(0, KEY, folder / "work")
    public, truth, motion = make.case(number, source)
    public.write(folder / "cases")
    make._keep(folder / "truth" / public.name, truth, motion)
    seal.write_seals(folder / "cases", make.truths(folder))
    return folder


def answered(edition: Path, effects: list[dict[str, object]]) -> layout.Given:
    """Return an answer that predicts with the file as given."""
    public = layout.Public.read(edition / "cases" / "c00")
    vehicle = vehicles.parse(public.vehicle)
    held = held_of(vehicle, public.held_out)
    velocities = as_given(vehicle, public, held)[1]
    return layout.Given(effects, 1.0, table_of(public.held_out, velocities, held))


def test_an_entrant_sees_no_motion_that_is_to_be_predicted(edition: Path) -> None:
    windows = pl.read_parquet(edition / "cases" / "c00" / "heldout.parquet")
    later = windows.filter(pl.col("t") > layout.LEAD + 1e-6)
    assert later.height > 200
    assert all(later[name].null_count() == later.height for name in layout.MOTION)
    assert windows.filter(pl.col("t") <= layout.LEAD)["u"].null_count() == 0
    public = "".join(path.read_text() for path in (edition / "cases").rglob("*.[jct]*"))
    assert "thruster_gain" not in public


def test_a_changed_truth_is_refused(edition: Path) -> None:
    path = edition / "truth" / "c00" / "truth.json"
    text = path.read_text()
    make.opened(edition, "c00")
    path.write_text(text.replace("-0.4", "-0.3"))
    with pytest.raises(SystemExit, match="not the sealed truth"):
        make.opened(edition, "c00")
    path.write_text(text)


def test_seeds_depend_on_the_key_and_avoid_all_others() -> None:
    seeds = [seal.seed(key, f"case {n}") for key in (KEY, bytes([1] * 32)) for n in range(20)]
    assert len(set(seeds)) == len(seeds)
    assert min(seeds) >= seal.SEEDS


def test_a_right_answer_scores_better_than_a_wrong_one(edition: Path) -> None:
    truth, motion = make.opened(edition, "c00")
    gains = [0.0, 0.0, -0.38, 0.0, 0.0, 0.0, 0.0, 0.0]
    told = {"name": "thruster_gain", "confidence": 0.95, "parameters": {"g": gains}}
    right = score.scored(truth, motion, answered(edition, [told | {"standard_errors": {"g": [0.02] * 8}}]))
    assert (right.first, right.within, right.alarm) == (True, (True,), None)
    assert right.brier == pytest.approx(0.05**2)
    narrow = score.scored(truth, motion, answered(edition, [told | {"standard_errors": {"g": [0.005] * 8}}]))
    assert narrow.within == (False,)
    wrong = score.scored(truth, motion, answered(edition, [{"name": "ocean_current"}]))
    assert (wrong.first, wrong.brier) == (False, 1.0)
    silent = score.scored(truth, motion, answered(edition, []))
    assert (silent.first, silent.brier) == (False, None)


def test_the_true_vehicle_predicts_without_error(edition: Path) -> None:
    truth, motion = make.opened(edition, "c00")
    public = layout.Public.read(edition / "cases" / "c00")
    hidden = f'\n[[effect]]\nname = "thruster_gain"\ng = {truth["values"]["thruster_gain"]["g"]}\n'
    vehicle = vehicles.parse(public.vehicle + hidden)
    held = held_of(vehicle, public.held_out)
    exact = table_of(public.held_out, as_given(vehicle, public, held)[1], held)
    given = answered(edition, []).prediction
    assert score.error(truth, motion, exact) < 0.05 * score.error(truth, motion, given)
    assert score.error(truth, motion, given.head(1)) > 10.0, "what is missing counts as far off"


def test_a_baseline_without_its_package_writes_no_answer(
    edition: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "benchmarks.challenge.network", raising=False)
    entry = edition / "entries" / "network"
    with pytest.raises(SystemExit, match="torch is not installed"):
        run("network", edition / "cases" / "c00", entry)
    assert not entry.exists()


def test_a_script_outside_the_package_enters(edition: Path) -> None:
    script = Path(layout.__file__).with_name("example_entry.py")
    line = [sys.executable, "-I", script, edition / "cases", edition / "entries" / "example"]
    subprocess.run(line, check=True, timeout=60)
    said = json.loads((edition / "entries" / "example" / "c00" / "answer.json").read_text())
    assert [one["name"] for one in said["effects"]] in ([], ["thruster_gain"])
    answered(edition, []).write(edition / "entries" / "file as given" / "c00")
    rows = board(edition, sorted((edition / "entries").iterdir()))
    assert {row["entry"] for row in rows} == {"example", "file as given"}
    assert all(row["cases"] == "1 of 60" for row in rows)


def test_the_common_board_has_the_cases_of_all_entries() -> None:
    def scores(*cases: str) -> list[score.Score]:
        return [score.Score(case, "panel", True, True, None, None, (), 1.0, 1.0) for case in cases]

    found = of_all({"hydro": scores("c00", "c01", "c02"), "slow": scores("c02", "c01")})
    assert {name: [one.case for one in those] for name, those in found.items()} == {
        "hydro": ["c01", "c02"],
        "slow": ["c02", "c01"],
    }


def test_a_random_order_has_every_case_once_and_is_that_of_its_seed() -> None:
    numbers = list(range(60))
    assert ordered(numbers, None) == numbers
    assert ordered(numbers, 1) == ordered(numbers, 1) != ordered(numbers, 2)
    assert sorted(ordered(numbers, 1)) == numbers


def test_turned_and_mirrored_recordings_obey_the_same_vehicle() -> None:
    """The vehicle is symmetric, so it moves as the mirrored and turned recording says."""
    raw = flown().head(400)
    for moved in (sources.turned(raw, 2.0), sources.mirrored(raw)):
        again = simulate(vehicles.parse(VEHICLE), moved)
        off = (again.select(layout.MOTION[:3]) - moved.select(layout.MOTION[:3])).to_numpy()
        assert np.abs(off).max() < 1e-3


def test_cases_take_turns_and_hide_nothing_in_a_quarter() -> None:
    numbers = [sources.Number(place, KEY, Path()) for place in range(make.CASES)]
    for simulator in sources.SIMULATORS:
        those = [one for one in numbers if one.simulator == simulator]
        assert (len(those), sum(not one.changed for one in those)) == (20, 5)
        assert sum(one.with_before for one in those) == 15
