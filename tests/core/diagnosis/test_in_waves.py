"""Diagnoses of vehicles in waves: these are named, with what else is missing, and nothing false is."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import polars as pl
import pytest

from hydro.core.columns import POSE, VELOCITY
from hydro.core.diagnosis.pipeline import diagnose
from hydro.core.evaluation.compare import compare
from hydro.core.explanation.explain import explain
from hydro.core.explanation.ladder import best
from hydro.core.identification.fit import fit
from hydro.core.sea.sea_state import SeaState
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.io import vehicle as vehicle_file

SEA = {"name": "ocean_waves", "height": 0.5, "period": 6.0, "direction": 0.7, "peak": 2.3}
STREAM = {"name": "ocean_current", "v_N": 0.25, "v_E": -0.15}


def flown(vehicle: Any, *hidden: dict[str, Any], seed: int = 0) -> pl.DataFrame:
    """A minute and a half of a vehicle with hidden effects, and noise."""
    rng, rows = np.random.default_rng(seed), 900
    sessions = []
    for number in range(2):
        t = np.arange(rows) * 0.05
        columns = {name: np.zeros(rows) for name in (*POSE, *VELOCITY)}
        columns |= {"z": np.full(rows, 4.0), "psi": np.full(rows, rng.uniform(-3.0, 3.0))}
        for i in range(len(vehicle.thruster)):
            waves = [np.sin(2 * np.pi * (rng.uniform(0.02, 0.5) * t + rng.uniform())) for _ in range(3)]
            columns[f"cmd_{i + 1}"] = 0.1 * sum(waves)
        sessions.append(pl.DataFrame({"session": [str(number)] * rows, "t": t} | columns))
    truth = msgspec.structs.replace(vehicle, effect=(*vehicle.effect, *hidden))
    motion = simulate(truth, pl.concat(sessions), sea=seed)
    logged = disturb(motion.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
    return motion.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))


@pytest.fixture(scope="module")
def vehicle(datasets: Any) -> Any:
    return vehicle_file.read(datasets / "vehicles" / "auv151.toml")[0]


@pytest.fixture(scope="module")
def in_waves(vehicle: Any) -> pl.DataFrame:
    return flown(vehicle, SEA)


@pytest.fixture(scope="module")
def explained(vehicle: Any, in_waves: pl.DataFrame) -> Any:
    """Steps of an explanation, and the diagnosis of each."""
    diagnoses: list[Any] = []

    def kept(_vehicle: Any, _log: Any, diagnosis: Any, _progress: Any) -> Any:
        diagnoses.append(diagnosis)
        return diagnosis

    return list(explain(vehicle, in_waves, beyond=kept)), diagnoses


@pytest.fixture(scope="module")
def named(explained: Any) -> Any:
    return explained[1][0]


def test_waves_are_the_only_finding_if_nothing_else_is_missing(named: Any) -> None:
    waves = named.findings[0]
    assert (waves.verdict, waves.effect) == ("missing", "ocean_waves")
    for name, value in SEA.items():
        if name != "name":
            assert abs(waves.parameters[name] - value) < 4.0 * waves.standard_errors[name]
    assert waves.share > 0.9
    assert "m/s" in waves.advice
    others = [one for one in named.findings[1:] if one.confidence >= 0.9]
    assert not others


def test_a_missing_effect_is_found_in_waves(vehicle: Any) -> None:
    found = diagnose(vehicle, flown(vehicle, SEA, STREAM, seed=3)).findings
    assert found[0].effect == "ocean_waves"
    named = {one.effect: one for one in found[1:] if one.parameters}
    stream = named["ocean_current"]
    for name in ("v_N", "v_E"):
        assert abs(stream.parameters[name] - STREAM[name]) < 4.0 * stream.standard_errors[name]
    assert not [one for one in named.values() if one is not stream and one.confidence >= 0.9]


def test_a_file_with_the_waves_has_nothing_missing(vehicle: Any, in_waves: pl.DataFrame) -> None:
    whole = msgspec.structs.replace(vehicle, effect=(*vehicle.effect, SEA))
    found = diagnose(whole, in_waves).findings
    assert not [one for one in found if one.verdict == "missing"]


def test_a_fit_with_known_waves_has_smaller_and_correct_standard_errors(
    vehicle: Any, in_waves: pl.DataFrame
) -> None:
    whole = msgspec.structs.replace(vehicle, effect=(*vehicle.effect, SEA))
    blind, aware = (fit(one, in_waves, ["linear_damping"]) for one in (vehicle, whole))
    true = np.array(next(iter(vehicle.effects("linear_damping")))["diagonal"])
    assert (np.abs(aware.values - true) < 4.0 * aware.standard_errors).all()
    assert (aware.standard_errors < 0.5 * blind.standard_errors).all()
    assert blind.chi2 > 10.0
    assert aware.chi2 < 1.3


def test_the_noise_floor_of_a_comparison_includes_the_waves_of_the_file(
    vehicle: Any, in_waves: pl.DataFrame
) -> None:
    whole = msgspec.structs.replace(vehicle, effect=(*vehicle.effect, SEA))
    rows = [
        compare(one, in_waves).filter(level="replay", by="all", axis="all", horizon=5.0)
        for one in (vehicle, whole)
    ]
    (error, calm), (same, swell) = ((one["rmse"][0], one["noise_floor"][0]) for one in rows)
    assert error == pytest.approx(same, rel=1e-6)
    assert calm < 0.3 * error
    assert 0.5 * error < swell < 2.0 * error


def test_explain_adds_waves_once(vehicle: Any, explained: Any) -> None:
    steps, _ = explained
    assert [step.added for step in steps[:2]] == [(), ("ocean_waves",)]
    last = best(steps).vehicle
    assert sum(table["name"] == "ocean_waves" for table in last.effect) == 1
    assert {table["name"] for table in last.effect} == {table["name"] for table in vehicle.effect} | {
        "ocean_waves"
    }


def test_a_swing_due_to_buoyancy_is_not_named_as_waves(vehicle: Any, monkeypatch: Any) -> None:
    """A vehicle that its buoyancy turns over swings: what it lacks is named, and no sea that is not there."""
    sea = SeaState(np.array([*list(SEA.values())[1:]]), 1e-4 * np.eye(4), 500.0, 200.0, 0.1)
    monkeypatch.setattr("hydro.core.diagnosis.baseline.shown", lambda *given: sea)
    hidden = {"name": "buoyancy_offset", "dx": 0.02, "dy": 0.01, "dz": 0.01}
    still = flown(vehicle, hidden).filter(session="0").head(600)
    found = [one for one in diagnose(vehicle, still).findings if one.verdict in ("missing", "suspect")]
    assert [one.effect for one in found] == ["buoyancy_offset"]
    assert found[0].confidence > 0.9
