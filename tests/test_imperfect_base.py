"""Changed vehicles whose hulls no formula describes: what flies, what is changed, and a study."""

from __future__ import annotations

import dataclasses
import json

import msgspec
import polars as pl
import pytest

from benchmarks.hidden_effects import vehicles
from benchmarks.imperfect_base import base, changes, study
from benchmarks.judge import studies
from benchmarks.judge.studies import LISTS
from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.vehicle.panels import panels
from hydro.io import vehicle as files


@pytest.mark.parametrize("preset", vehicles.PRESETS)
def test_hulls_have_their_vehicles_size_and_no_symmetry_fore_and_aft(preset):
    vehicle = vehicles.preset(preset)
    size = [vehicle.hull.length, vehicle.hull.width, vehicle.hull.height]
    full, tapered = (panels(*base.hull(vehicle, taper)) for taper in (0.0, 0.6))
    for one in (full, tapered):
        assert one.extent == pytest.approx(size, rel=0.02)
    assert tapered.volume < full.volume
    assert abs(full.center[0] - vehicle.hull.center[0]) < 1e-9
    assert abs(tapered.center[1] - vehicle.hull.center[1]) < 1e-9  # port and starboard stay mirrored


def test_thirty_changes_each_come_once_in_thirty_seeds():
    drawn = [changes.draw("changed", seed) for seed in range(100, 130)]
    assert sorted(case.title for case in drawn) == sorted(changes.CHANGES)
    assert len(changes.CHANGES) == 30
    for case in drawn:
        assert case.called == (changes.CHANGES[case.title][0],)
        assert case.hidden[0]["name"] == case.called[0]
    assert {case.preset for case in drawn} == set(vehicles.PRESETS)
    assert all(not changes.draw("nothing", seed).hidden for seed in range(100, 104))


def test_a_case_comes_from_its_seed_alone():
    again = [changes.draw("changed", 17), changes.draw("nothing", 5), changes.draw("changed", 17)]
    assert again[0] == again[2]


def test_effects_of_panels_are_refused(monkeypatch):
    effect = CATALOGUE["quadratic_damping"]
    panelled = dataclasses.replace(effect, definition="tau = sum over panels")
    monkeypatch.setitem(CATALOGUE, "hull_drag", panelled)
    with pytest.raises(DataError, match="hull_drag"):
        changes.draw("changed", 0)


SECONDS = 32.0
"""Length of the flights in the study: four sessions that hold a prediction each."""
UNCHANGED = 40.0
"""Length of the flights that the file is fitted to."""
SEED = next(seed for seed in range(300, 400) if changes.draw("changed", seed).title == "ocean_current")


@pytest.fixture(scope="module")
def panel(tmp_path_factory):
    """A study of the list `panel-before`, and the unchanged vehicle."""
    folder = tmp_path_factory.mktemp("imperfect_base")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(base, "UNCHANGED", UNCHANGED)
        one = LISTS["panel-before"].prepare(SEED, SECONDS, folder)
    return one, base.of(changes.draw("changed", SEED).preset, SEED, UNCHANGED, folder / "bases")


@pytest.mark.slow
def test_a_change_stands_out_of_the_noise_and_makes_its_share(panel):
    one, known = panel
    assert one.called == ("ocean_current",)
    assert one.facts["share"] >= study.SHARE
    case, error, floor = study.standing_out(changes.draw("changed", SEED), known, SECONDS)
    assert error >= study.STANDS_OUT * floor
    assert case.noise == one.facts["noise"]
    true = [{"name": "ocean_current", **one.truth.effects("ocean_current")[0]}]
    assert one.errors.of(vehicles.joined(one.given, true)) < one.errors.of(one.given)


@pytest.mark.slow
def test_the_fitted_file_is_that_of_the_unchanged_flights(panel):
    one, known = panel
    flown = pl.read_parquet(known.unchanged)
    assert flown.height == round(UNCHANGED / 0.02)
    assert one.before.equals(flown)
    believed = {table["name"]: table for table in known.believed.effect}
    assert {table["name"] for table in known.vehicle.effect} == set(believed)
    assert any("standard_error" in table for table in known.vehicle.effect)
    errors = Ahead(flown, known.vehicle)
    assert errors.of(known.vehicle) < 0.7 * errors.of(known.believed)
    assert msgspec.structs.replace(known.vehicle, effect=()) == msgspec.structs.replace(
        known.believed, effect=()
    )


@pytest.mark.slow
def test_a_study_is_written_as_files(panel, tmp_path):
    one, _ = panel
    studies.write(one, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "after.parquet",
        "before.parquet",
        "held_out.parquet",
        "truth.json",
        "vehicle.toml",
    ]
    assert files.vehicle_hash(files.read(tmp_path / "vehicle.toml")[0]) == files.vehicle_hash(one.given)
    for name, table in {"before": one.before, "after": one.measured, "held_out": one.held_out}.items():
        assert pl.read_parquet(tmp_path / f"{name}.parquet").equals(table)
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth["called"] == ["ocean_current"]
    assert truth["hidden"][0]["name"] == "ocean_current"
