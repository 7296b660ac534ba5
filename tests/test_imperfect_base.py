"""Changed vehicles whose hulls no formula describes: what flies, what is changed, and a study."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import polars as pl
import pytest

from benchmarks.hidden_effects import vehicles
from benchmarks.imperfect_base import base, changes, study
from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.vehicle.panels import panels

ROOT = Path(__file__).resolve().parents[1]


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
"""Of the flights in a study: four sessions that hold a prediction each,"""
UNCHANGED = 40.0
"""and of those that the file is fitted to."""


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """One study, run twice from the command line."""
    folder = tmp_path_factory.mktemp("imperfect_base")
    seed = next(s for s in range(300, 400) if changes.draw("changed", s).title == "ocean_current")
    preset = changes.draw("changed", seed).preset
    arguments = ["--first-seed", seed, "--studies", 1, "--seconds", SECONDS, "--unchanged", UNCHANGED]
    arguments += ["-o", folder / "rows.parquet"]
    command = [sys.executable, "-m", "benchmarks.imperfect_base", "run", "--kind", "changed", *arguments]
    printed = [
        subprocess.run(list(map(str, command)), cwd=ROOT, text=True, capture_output=True, check=False)
        for _ in range(2)
    ]
    return folder, seed, preset, printed


@pytest.mark.slow
def test_a_study_from_the_command_line(done):
    folder, seed, preset, (first, second) = done
    assert first.returncode == 0, first.stderr
    (row,) = pl.read_parquet(folder / "rows.parquet").to_dicts()
    assert row["failure"] == ""
    assert row["unchanged_seconds"] == UNCHANGED
    assert (row["seed"], row["preset"], row["called"]) == (seed, preset, ["ocean_current"])
    assert row["base_error"] >= study.STANDS_OUT * row["base_floor"]
    assert row["share"] >= study.SHARE
    assert row["oracle"] < row["before"], "the true change, fitted, takes error away"
    assert row["verdicts"]
    assert 0.0 < row["cpu"] <= row["study_cpu"]
    assert "base" in first.stdout
    assert second.stdout == "", "what is in the file is not run again"


@pytest.mark.slow
def test_the_fitted_file_is_that_of_the_unchanged_flights(done):
    folder, seed, preset, _ = done
    known = base.of(preset, seed, UNCHANGED, folder / "bases")
    flown = pl.read_parquet(known.unchanged)
    assert flown.height == round(UNCHANGED / 0.02)
    believed = {table["name"]: table for table in known.believed.effect}
    assert {table["name"] for table in known.vehicle.effect} == set(believed)
    assert any("standard_error" in table for table in known.vehicle.effect)
    errors = Ahead(flown, known.vehicle)
    assert errors.of(known.vehicle) < 0.7 * errors.of(known.believed)
    assert msgspec.structs.replace(known.vehicle, effect=()) == msgspec.structs.replace(
        known.believed, effect=()
    )
    study.write(changes.draw("changed", seed), SECONDS, UNCHANGED, folder / "bases", folder / "written")
    assert sorted(path.name for path in (folder / "written").iterdir()) == [
        "after.parquet",
        "before.parquet",
        "held_out.parquet",
        "truth.json",
        "vehicle.toml",
    ]
    assert pl.read_parquet(folder / "written" / "before.parquet").equals(flown)
    assert np.isfinite(pl.read_parquet(folder / "written" / "after.parquet")["u"].to_numpy()).all()
