"""A vehicle moved step by step moves as the whole flight does."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation
from sim.effects import EFFECTS, ETA, NU, commands, preset, with_effect

from hydro.core.columns import MOTION, POSE, VELOCITY, command_columns
from hydro.core.errors import DataError
from hydro.core.simulation.live import Live
from hydro.core.simulation.simulate import simulate

DT = 0.02


def flown(craft, given, eta, nu):
    """Motion (N, 12) by `simulate`, and by steps."""
    rows = len(given)
    table = pl.DataFrame({"session": ["s"] * rows, "t": np.arange(rows) * DT})
    table = table.with_columns(
        pl.Series(name, column)
        for name, column in zip(command_columns(len(craft.thruster)), given.T, strict=True)
    )
    first = pl.DataFrame([[*eta, *nu]] * rows, schema=[*POSE, *VELOCITY], orient="row")
    whole = simulate(craft, pl.concat([table, first], how="horizontal")).select(MOTION).to_numpy()
    live = Live(craft)
    live.reset(eta, nu)
    motion = []
    for row in given:
        reading = live.read()
        motion.append([*reading.eta, *reading.nu])
        live.step(row, DT)
    return whole, np.array(motion)


@pytest.mark.parametrize("effect", EFFECTS)
def test_steps_make_up_the_flight(datasets, effect):
    craft = with_effect(preset(datasets, "auv151"), effect)
    whole, motion = flown(craft, commands(8, rows=60), ETA, NU)
    np.testing.assert_allclose(motion, whole, atol=1e-12)


def test_a_delay_of_several_steps_is_kept(datasets):
    craft = preset(datasets, "auv151")
    late = [msgspec.structs.replace(one, delay=0.0537 * (1 + i)) for i, one in enumerate(craft.thruster)]
    whole, motion = flown(msgspec.structs.replace(craft, thruster=tuple(late)), commands(8, rows=80), ETA, NU)
    np.testing.assert_allclose(motion, whole, atol=1e-12)


def test_what_is_felt_is_the_acceleration_less_gravity(datasets):
    live = Live(preset(datasets, "auv151"))
    live.reset(ETA, NU)
    readings = []
    for _ in range(3):
        readings.append(live.read())
        live.step(np.full(8, 0.4), 1e-3)
    turned = Rotation.from_euler("ZYX", [*readings[1].eta[:2:-1]]).as_matrix()
    rate = (readings[2].velocity - readings[0].velocity) / 2e-3
    np.testing.assert_allclose(readings[1].specific_force, turned.T @ (rate - [0.0, 0.0, 9.81]), atol=5e-4)
    np.testing.assert_allclose(turned @ readings[1].nu[:3], readings[1].velocity, atol=1e-12)


def test_it_begins_anew(datasets):
    live = Live(with_effect(preset(datasets, "auv151"), "fluid_memory"))
    ends = []
    for _ in range(2):
        live.reset(ETA, NU)
        for row in commands(8, rows=20):
            live.step(row, DT)
        ends.append(live.read())
    assert all(np.array_equal(one, other) for one, other in zip(*ends, strict=True))
    assert ends[0].time == pytest.approx(0.4)


def test_commands_that_do_not_fit_and_a_motion_without_bounds_are_refused(datasets):
    live = Live(preset(datasets, "auv151"))
    with pytest.raises(DataError, match="expected 8, one for each thruster"):
        live.step(np.zeros(3), DT)
    wild = {"name": "linear_damping", "diagonal": [-1e6] * 6}
    live = Live(msgspec.structs.replace(preset(datasets, "auv151"), effect=(wild,)))
    live.reset(ETA, NU)
    with pytest.raises(DataError, match="the motion diverges by t = "):
        any(live.step(np.zeros(8), DT) for _ in range(2000))
