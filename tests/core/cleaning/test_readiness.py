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
from hydro.core.diagnosis.pipeline import diagnose
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
        assert "nothing can be concluded about the vehicle" in told
        assert "\n" not in told


@pytest.mark.parametrize("ask", [diagnose, lambda vehicle, raw: next(explain(vehicle, raw))])
def test_no_effect_is_named_of_it(ask):
    with pytest.raises(DataError, match="the thrusters never ran and the vehicle did not move"):
        ask(VEHICLE, idle("bench", 1))


def keyboard(seed):
    """Surge and heave by a keyboard for 215 s at 5 Hz; roll, pitch and yaw are the noise of their sensors."""
    rng, dt, rows = np.random.default_rng(seed), 0.01, 21_500
    keys, at = np.zeros((rows, 2)), 0
    while at < rows:
        held = int(rng.uniform(0.3, 1.5) / dt)
        keys[at : at + held] = rng.choice([-0.75, -0.5, -0.25, 0.0, 0.0, 0.25, 0.5, 0.75], 2) * [1.0, 0.5]
        at += held
    speed = np.zeros((rows, 2))
    for k in range(rows - 1):
        drag = [13.7, 33.0] * speed[k] + [141.0, 190.0] * np.abs(speed[k]) * speed[k]
        speed[k + 1] = speed[k] + dt * (keys[k] * [86.0, 122.0] - drag) / [19.9, 32.2]
    place, every = np.cumsum(speed, axis=0) * dt, slice(None, None, 19)
    count = len(place[every])
    motion = np.zeros((count, 12))
    motion[:, [0, 2]], motion[:, [6, 8]] = place[every] + [0.0, 1.5], speed[every]
    motion += np.repeat([0.002, 0.001, 0.003, 0.003], 3) * rng.standard_normal(motion.shape)
    surge, heave = keys[every].T
    return pl.DataFrame(
        {"session": ["a"] * count, "t": np.arange(count) * 0.19}
        | dict(zip((*POSE, *VELOCITY), motion.T, strict=True))
        | {f"cmd_{i + 1}": sign * surge for i, sign in enumerate((1.0, 1.0, -1.0, -1.0))}
        | {f"cmd_{i + 5}": -heave for i in range(4)}
    )


@pytest.mark.parametrize("seed", range(4))
def test_columns_of_axes_at_rest_are_what_they_are_called(seed):
    """Noise of 1 mrad is explained better by degrees, and by other frames by chance."""
    assert cleaned(VEHICLE, keyboard(seed)).changes == ()


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
