"""Fins that obey commands, and the servos that these belong to."""

from __future__ import annotations

import warnings

import msgspec
import numpy as np
import polars as pl
import pytest
from bench import BARE, equipped, neutral, wrench
from hypothesis import given
from strategies import numbers, vectors, velocities

from hydro.core.columns import POSE, VELOCITY
from hydro.core.effects import assemble, effect_wrenches
from hydro.core.effects.catalogue import thruster_table
from hydro.core.effects.sums import validate
from hydro.core.errors import DataError, HydroWarning
from hydro.core.identification.fit import fit
from hydro.core.prediction.parameters import free
from hydro.core.simulation.simulate import trajectory
from hydro.core.vehicle.control_allocation import mixing, mixing_kernel
from hydro.core.vehicle.description import Thruster
from hydro.core.vehicle.thrusters import TIME_CONSTANT
from hydro.io import vehicle as files

LEVEL = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
RHO = 1025.0
LATE = msgspec.structs.replace(
    BARE, thruster=tuple(msgspec.structs.replace(one, time_constant=0.2) for one in BARE.thruster)
)


def close(actual, expected, rtol=1e-9, atol=1e-9):
    np.testing.assert_allclose(actual, expected, rtol=rtol, atol=atol)


def rolls():
    return numbers(-1.1, 1.9)


def fin(**given):
    return {"name": "control_surface", "area": 0.02, "stall": 0.35, **given}


def steered(*names, bare=None):
    """The bare vehicle with servos behind its two thrusters: their commands are c3, c4, ..."""
    servos = tuple(Thruster(name, curve="none") for name in names)
    bare = bare or equipped()
    return msgspec.structs.replace(bare, thruster=(*bare.thruster, *servos))


@given(velocities(), rolls(), numbers(-0.5, 0.5), vectors(2, 1.0), vectors(2, 0.4))
def test_a_fin_is_turned_by_its_commands_as_by_a_deflection(nu, roll, deflection, commands, turn):
    """The mixed fins of an X tail obey two of them; the servos push nothing themselves."""
    place = {"position": [-0.7, 0.1, 0.0], "roll": roll}
    fixed = fin(deflection=deflection + float(turn @ commands), **place)
    driven = fin(deflection=deflection, commands=["c4", "c3"], turn=turn.tolist(), **place)
    vehicle = equipped(driven, bare=steered("rudder", "elevator"))
    row = LEVEL[None], nu[None], [[0, 1]], [0.0], np.array([[0.3, -0.2, commands[1], commands[0]]])
    close(effect_wrenches(vehicle, *row)[0], wrench(fixed, LEVEL, nu), rtol=1e-9, atol=1e-9)


def test_a_rudder_turns_a_vehicle_the_way_of_its_command_from_that_row_on():
    """Its trailing edge to starboard, the rudder is pushed to port astern, and the bow goes to starboard."""
    bare = steered("rudder", bare=neutral())
    rudder = fin(position=[-0.7, 0, 0], roll=np.pi / 2, commands=["c2"], turn=[0.1])
    commands, t = np.zeros((100, 2)), np.arange(100) * 0.02
    commands[50:, 1] = -1.0
    vehicle = equipped(rudder, bare=bare)
    r = trajectory(assemble(vehicle), commands, t, nu=[1.5, 0, 0, 0, 0, 0])[:, 11]
    close(r[:51], np.zeros(51))
    assert r[51] > 0.0
    force = 0.5 * RHO * 0.02 * 1.5**2 * np.pi * 0.1
    assert r[51] == pytest.approx(0.7 * force / 5.5 * 0.02, rel=0.1)


def test_actuator_effects_leave_servos_alone():
    """Thrusters may be quicker than their file says, though a servo has no lag to lose."""
    vehicle = steered("rudder", bare=equipped({"name": "thruster_lag", "dT": -0.05}, bare=LATE))
    plain = thruster_table(steered("rudder", bare=LATE))
    table = thruster_table(vehicle)
    close(table[2], plain[2])
    close(table[:2, TIME_CONSTANT], plain[:2, TIME_CONSTANT] - 0.05)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"commands": ["c4"], "turn": [0.3]}, "c4 is no thruster's command: the vehicle has 3"),
        ({"commands": ["rudder"], "turn": [0.3]}, "must be a list of commands, c1 to c16"),
        ({"commands": "c3", "turn": [0.3]}, "must be a list of commands"),
        ({"commands": ["c3", "c3"], "turn": [0.3, 0.3]}, "a command stands twice: c3, c3"),
        ({"commands": ["c3"], "turn": [0.3, 0.3]}, r"\.turn: must be an array of 1 numbers"),
        ({"turn": [0.3]}, r"\.turn: must be an array of 0 numbers"),
    ],
)
def test_a_fin_that_obeys_nothing_known_is_refused(more, message):
    with pytest.raises(DataError, match=message):
        validate(equipped(fin(**more), bare=steered("rudder")))


def test_a_servo_has_a_name_alone():
    servo = Thruster("rudder", position=(0.0, 0.0, 0.0), curve="none")
    bare = equipped()
    with pytest.raises(DataError, match='thruster rudder: with curve "none", give only a name'):
        validate(msgspec.structs.replace(bare, thruster=(*bare.thruster, servo)))


@pytest.mark.parametrize("method", ["equation", "output"])
def test_a_driven_fin_is_fitted(method):
    true = fin(position=[-0.7, 0, 0], roll=np.pi / 2, commands=["c2"], turn=[0.3])
    drag = {"name": "quadratic_damping", "diagonal": [9.0, 40.0, 40.0, 2.0, 9.0, 9.0]}
    bare, t, rng = steered("rudder", bare=neutral()), np.arange(3000) * 0.02, np.random.default_rng(0)
    steps = np.repeat(rng.uniform(-1.0, 1.0, (300, 2)), 10, axis=0)
    commands = np.column_stack([0.6 + 0.3 * steps[:, 0], steps[:, 1]])
    motion = trajectory(assemble(equipped(true, drag, bare=bare)), commands, t)
    values = dict(zip((*POSE, *VELOCITY, "cmd_1", "cmd_2"), np.hstack([motion, commands]).T, strict=True))
    begun = {**true, "area": 0.012, "turn": [0.15], "known": ["position", "roll", "deflection", "stall"]}
    raw = pl.DataFrame({"session": ["a"] * 3000, "t": t, **values})
    found = fit(equipped(begun, drag, bare=bare), raw, ["control_surface"], method=method)
    table = found.vehicle.effects("control_surface")[0]
    assert table["commands"] == ["c2"]
    assert [table["area"], *table["turn"]] == pytest.approx([0.02, 0.3], rel=0.02)


@pytest.mark.parametrize("wanted", [["control_surface"], ["control_surface:stern"]])
def test_fins_are_fitted_each_by_itself(wanted):
    """All of a name, or the one that is named while the other stays as it is."""
    held = ["area", "position", "roll", "stall"]
    rudder = fin(position=[-0.7, 0, 0], roll=np.pi / 2, deflection=0.05)
    stern = fin(position=[-0.7, 0, 0], deflection=-0.08)
    drag = {"name": "quadratic_damping", "diagonal": [9.0, 40.0, 40.0, 2.0, 9.0, 9.0]}
    bare, t = neutral(), np.arange(3000) * 0.02
    steps = np.repeat(np.random.default_rng(0).uniform(-1.0, 1.0, (300, 1)), 10, axis=0)
    commands = 0.6 + 0.3 * steps
    motion = trajectory(assemble(equipped(rudder, stern, drag, bare=bare)), commands, t)
    values = dict(zip((*POSE, *VELOCITY, "cmd_1"), np.hstack([motion, commands]).T, strict=True))
    raw = pl.DataFrame({"session": ["a"] * 3000, "t": t, **values})
    known = {"control_surface:rudder": 0.0 if len(wanted[0]) < 16 else 0.05, "control_surface:stern": 0.0}
    shapes = {"control_surface:rudder": rudder, "control_surface:stern": stern}
    begun = [shapes[name] | {"name": name, "deflection": d, "known": held} for name, d in known.items()]
    found = fit(equipped(*begun, drag, bare=bare), raw, wanted, method="equation").vehicle
    assert [one["deflection"] for one in found.effects("control_surface")] == pytest.approx(
        [0.05, -0.08], rel=0.05
    )


def test_a_pilot_s_allocation_is_that_of_the_thrusters_alone(datasets):
    vehicle = files.read(datasets / "vehicles" / "auv151.toml")[0]
    with_servo = mixing(steered("rudder", bare=vehicle), np.eye(6))
    alone = mixing(vehicle, np.eye(6))
    close(with_servo.authority, alone.authority)
    close(with_servo.gains, alone.gains)
    commands = np.ones(len(vehicle.thruster) + 1)
    mixing_kernel(with_servo.allocation, with_servo.table, np.array([20.0, 5, -9, 0, 0, 3]), commands)
    assert commands[-1] == 0.0
    assert np.abs(commands[:-1]).max() > 0.0


def test_a_servo_that_nothing_obeys_is_told_of(tmp_path, datasets):
    text = (datasets / "vehicles" / "auv151.toml").read_text(encoding="utf-8")
    servo = '\n[[thruster]]\nname = "rudder"\ncurve = "none"\n'
    obeys = (
        '[[effect]]\nname = "formula"\nmoments = ["N c9 |u| u"]\nmoment = [2.0]\nforces = []\nforce = []\n'
    )
    with pytest.warns(
        HydroWarning, match="thruster rudder: no effect uses its command: add a control_surface"
    ):
        files.warn(files.parse(text + servo), text, "x.toml")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        files.warn(files.parse(text + servo + obeys), text, "x.toml")


def test_effects_of_thrusters_have_no_entries_of_servos():
    entries = free(steered("rudder"), ["thruster_gain"]).entries
    assert [entry.index for entry in entries] == [(0,), (1,)]
