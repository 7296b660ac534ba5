"""Nothing is said of a vehicle that did nothing, and nothing is refused of one that moved."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import damped, log, moved, noisy

from benchmarks.unready import KINDS
from benchmarks.unready import recording as idle
from hydro.core.cleaning.cleaned import cleaned
from hydro.core.cleaning.readiness import command_step, unready
from hydro.core.columns import POSE, VELOCITY
from hydro.core.diagnosis.diagnose import diagnose
from hydro.core.errors import DataError
from hydro.core.explanation.explain import explain
from hydro.core.recording.arrays import recording

VEHICLE = damped()
WORDS = {
    "motionless": "never ran",
    "bench": "never ran",
    "surface": "surface",
    "unarmed": "did not move",
}


def why(raw):
    return unready(recording(VEHICLE, raw))


@pytest.mark.parametrize("kind", KINDS)
def test_a_vehicle_that_does_nothing_is_told_in_one_sentence(kind):
    for seed in range(4):
        told = why(idle(kind, seed))
        assert WORDS[kind] in told
        assert "nothing can be told of the vehicle" in told
        assert "\n" not in told


@pytest.mark.parametrize("ask", [diagnose, lambda vehicle, raw: next(explain(vehicle, raw))])
def test_no_effect_is_named_of_it(ask):
    with pytest.raises(DataError, match="the thrusters never ran and the vehicle did not move"):
        ask(VEHICLE, idle("bench", 1))


@pytest.mark.parametrize("seed", range(3))
def test_columns_of_a_vehicle_at_rest_are_what_they_are_called(seed):
    """Noise of 1 mrad at 5 Hz is explained better by degrees, and by any other frame by chance."""
    rng, rows = np.random.default_rng(seed), 1000
    rest = pl.DataFrame(
        {"session": ["a"] * rows, "t": np.arange(rows) * 0.2}
        | {name: 1e-3 * rng.standard_normal(rows) for name in POSE}
        | {name: 3e-3 * rng.standard_normal(rows) for name in VELOCITY}
        | {f"cmd_{i + 1}": np.zeros(rows) for i in range(8)}
    )
    assert cleaned(VEHICLE, rest).changes == ()


FLIGHTS = {
    "all axes": lambda: moved(VEHICLE, rows=1500),
    "level, at the origin": lambda: moved(VEHICLE, rows=1500, thrusters=range(4)),
    "heave": lambda: moved(VEHICLE, rows=1500, thrusters=range(4, 8)),
    "one thruster": lambda: moved(VEHICLE, rows=1500, thrusters=[2]),
    "independent oracle": lambda: synthetic.recording(),
    "carried around, thrusters off": log,
}


@pytest.mark.parametrize("flight", FLIGHTS.values(), ids=FLIGHTS)
@pytest.mark.parametrize("rate", [50, 5, 2])
def test_a_vehicle_that_moved_is_ready(flight, rate):
    raw = noisy(flight(), 1)[:: 50 // rate]
    assert why(raw) == ""
    blind = raw.with_columns(pl.lit(None, pl.Float64).alias(name) for name in ("x", "y", *VELOCITY))
    assert why(blind) == ""


def sinking(speed):
    """Thrusters off, nothing but depth at 5 Hz."""
    t, rng = np.arange(0.0, 30.0, 0.2), np.random.default_rng(0)
    empty = {name: pl.Series([None] * len(t), dtype=pl.Float64) for name in (*POSE, *VELOCITY)}
    depth = {"z": 0.12 + speed * t + 0.002 * rng.standard_normal(len(t))}
    off = {f"cmd_{i + 1}": np.zeros(len(t)) for i in range(8)}
    return pl.DataFrame({"session": ["a"] * len(t), "t": t} | empty | depth | off)


def test_a_vehicle_that_sinks_with_its_thrusters_off_is_ready():
    assert why(sinking(0.05)) == ""
    assert why(sinking(-0.05)) == ""
    assert "never ran" in why(sinking(0.0))


def test_commands_that_are_sampled_too_slowly_are_told():
    raw = noisy(moved(VEHICLE, rows=4000), 2)
    every = 100
    held = raw.with_columns(
        pl.Series(f"cmd_{i + 1}", np.repeat(raw[f"cmd_{i + 1}"].to_numpy()[::every], every)) for i in range(8)
    )
    assert command_step(recording(VEHICLE, held)) == pytest.approx(2.0)
    assert "commands are sampled every 2 s" in why(held)
    levels = np.random.default_rng(1).choice([-0.5, 0.0, 0.5], 40)
    steps = raw.with_columns(
        pl.Series("cmd_1", np.repeat(levels, every)), **{f"cmd_{i}": pl.lit(0.0) for i in range(2, 9)}
    )
    assert why(steps) == ""
