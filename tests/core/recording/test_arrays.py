"""Noise found from the samples of a log: of slow sensors by their own pace, of smooth motion none."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import damped, moved, noisy

from hydro.core.columns import POSE, VELOCITY
from hydro.core.recording.arrays import drawn, noise, recording
from hydro.core.simulation.simulate import simulate

NOISE = np.repeat([0.02, 0.001, 0.01, 0.002], 3)
SLOW = ("x", "y", "z", "u", "v", "w")


def slowed(raw: pl.DataFrame, rate: float, how: str) -> pl.DataFrame:
    """Position and velocity as a sensor of `rate` gives them, on a clock of its own, held or drawn in lines.

    `jittered`: its stamps are off their beat by up to a third; `float32`: and the table is stored so.
    """
    t = raw["t"].to_numpy()
    at = np.arange(t[0] + 0.007, t[-1], 1.0 / rate)
    if how == "jittered":
        at = at + np.random.default_rng(0).uniform(-0.3, 0.3, len(at)) / rate
    clean = {name: np.interp(at, t, raw[name]) for name in SLOW}
    rng = np.random.default_rng(1)
    size = {name: 0.02 if name in "xyz" else 0.01 for name in SLOW}
    read = {name: clean[name] + size[name] * rng.standard_normal(len(at)) for name in SLOW}
    if how == "held":
        place = np.maximum(np.searchsorted(at, t, side="right") - 1, 0)
        columns = {name: values[place] for name, values in read.items()}
    else:
        columns = {name: np.interp(t, at, values) for name, values in read.items()}
    kind = pl.Float32 if how == "float32" else pl.Float64
    return raw.with_columns(pl.Series(name, values, dtype=kind) for name, values in columns.items())


@pytest.mark.parametrize("how", ["lines", "held", "jittered", "float32"])
@pytest.mark.parametrize("rate", [2.0, 5.3, 10.0])
def test_the_noise_of_a_slower_sensor_is_that_of_its_samples(rate, how):
    """Between its samples there is none; rows a sample apart have what the samples have, or a little less."""
    raw = moved(damped(), rows=6000)
    record = recording(damped(), slowed(noisy(raw, 0), rate, how))
    assert drawn(record, slice(3))
    assert drawn(record, slice(6, 9))
    assert not drawn(record, slice(3, 6))
    assert not drawn(record, slice(9, 12))
    found = noise(record)
    assert (found[[0, 1, 2, 6, 7, 8]] > 0.5 * NOISE[[0, 1, 2, 6, 7, 8]]).all()
    np.testing.assert_allclose(found[[3, 4, 5, 9, 10, 11]], NOISE[[3, 4, 5, 9, 10, 11]], rtol=0.06)


def thrust_in_steps(seconds: float, rest: float, lag: float) -> pl.DataFrame:
    """Noise-free motion under commands that jump every so often, with long rests between bursts."""
    known = damped()
    thrusters = tuple(msgspec.structs.replace(one, time_constant=lag) for one in known.thruster)
    known = msgspec.structs.replace(known, thruster=thrusters)
    rows, rng = 6000, np.random.default_rng(3)
    t = np.arange(rows) * 0.02
    steps = np.floor(t / seconds).astype(int)
    drive = rng.uniform(-0.6, 0.6, (steps.max() + 1, 8))[steps]
    drive[(t % 30.0) < rest] = 0.0
    columns = {f"cmd_{i + 1}": drive[:, i] for i in range(8)}
    return simulate(known, pl.DataFrame({"session": ["a"] * rows, "t": t, **columns}))


@pytest.mark.parametrize("lag", [0.0, 0.15])
@pytest.mark.parametrize("rest", [0.0, 20.0])
@pytest.mark.parametrize("seconds", [0.7, 3.0])
@pytest.mark.parametrize("kind", [pl.Float32, pl.Float64])
def test_smooth_motion_has_no_noise_however_still_it_is(seconds, rest, lag, kind):
    raw = thrust_in_steps(seconds, rest, lag).with_columns(pl.col(*POSE, *VELOCITY).cast(kind))
    record = recording(synthetic.vehicle(), raw)
    assert noise(record).max() < 2e-4
