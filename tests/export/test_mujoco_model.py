"""Exported MJCF: motion equal to `simulate`."""

from __future__ import annotations

import msgspec
import mujoco
import numpy as np
import pytest
from export.flown import VEHICLES, apart, flown, vehicle
from sim.effects import EFFECTS, with_effect

import hydro
from hydro.core.errors import DataError
from hydro.core.recording.supply import effective_commands
from hydro.export.mujoco_model import to_mjcf, warnings
from hydro.sim.bridge import states

STEPS = 10
"""Physics steps of a row."""


def motion_of(model, data, controls):
    """Return the motion (N, 12) under controls held for a row each."""
    rows = [np.concatenate(states.from_mujoco(data.qpos, data.qvel))]
    for row in controls[:-1]:
        data.ctrl[: len(row)] = row
        mujoco.mj_step(model, data, STEPS)
        rows.append(np.concatenate(states.from_mujoco(data.qpos, data.qvel)))
    return np.array(rows)


def loaded(craft, tmp_path):
    place = tmp_path / "rov.xml"
    place.write_bytes(to_mjcf(craft))
    return hydro.load_student(place)


@pytest.mark.parametrize("name", VEHICLES)
def test_sixty_seconds_are_those_of_simulate(datasets, name, tmp_path):
    commands, motion = flown(datasets, name)
    craft = vehicle(datasets, name)
    flight = motion_of(*loaded(craft, tmp_path), effective_commands(craft, commands))
    assert apart(flight, motion) < 1e-6


def test_a_file_holds_what_the_model_held_to_the_last_digit(datasets, tmp_path):
    craft = vehicle(datasets, "auv151")
    for effect in EFFECTS:
        craft = with_effect(craft, effect)
    written, _ = loaded(craft, tmp_path)
    made, _ = hydro.student(craft, integrator="rk4")
    for name in ("numeric_data", "body_mass", "body_inertia", "body_ipos", "body_gravcomp", "site_pos"):
        np.testing.assert_array_equal(getattr(written, name), getattr(made, name), err_msg=name)
    for name in ("actuator_gear", "actuator_ctrlrange", "actuator_gainprm", "actuator_delay"):
        np.testing.assert_array_equal(getattr(written, name), getattr(made, name), err_msg=name)
    np.testing.assert_allclose(written.body_iquat, made.body_iquat, atol=1e-15)


def test_a_student_of_the_api_is_that_of_the_file(datasets, tmp_path):
    commands, _ = flown(datasets, "auv151")
    craft = vehicle(datasets, "auv151")
    made = motion_of(*hydro.student(craft, integrator="rk4"), commands[:200])
    assert apart(motion_of(*loaded(craft, tmp_path), commands[:200]), made) < 1e-12


def test_a_vehicle_without_thrusters_sinks(datasets, tmp_path):
    craft = vehicle(datasets, "auv151")
    bare = msgspec.structs.replace(
        craft, thruster=(), buoyancy=msgspec.structs.replace(craft.buoyancy, force=1400.0)
    )
    model, data = loaded(bare, tmp_path)
    mujoco.mj_step(model, data, 500)
    assert states.from_mujoco(data.qpos, data.qvel)[0][2] > 0.1


def test_effective_commands_are_warned_of(datasets):
    assert warnings(vehicle(datasets, "auv151")) == []
    (words,) = warnings(vehicle(datasets, "bluerov2_heavy"))
    assert words.startswith("T1, T2")
    assert "effective_commands" in words


def test_files_that_are_none_are_refused_in_one_line(datasets, tmp_path):
    place = tmp_path / "rov.xml"
    with pytest.raises(DataError, match=r"rov\.xml: no such file"):
        hydro.load_student(place)
    place.write_text("<mujoco><worldbody/></mujoco>")
    with pytest.raises(DataError, match="no vehicle in water: make one with"):
        hydro.load_student(place)
    place.write_bytes(to_mjcf(vehicle(datasets, "auv151")).replace(b"<numeric", b"<numeri"))
    with pytest.raises(DataError) as caught:
        hydro.load_student(place)
    assert "\n" not in str(caught.value)
