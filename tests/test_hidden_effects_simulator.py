"""The simulator of the benchmark of hidden effects against `simulation.simulate`: two codes, one physics."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest

from benchmarks.hidden_effects import build, cases, flights, plant, vehicles
from hydro.core.columns import POSE, VELOCITY
from hydro.core.effects import CATALOGUE, sensor, velocity_log
from hydro.core.simulation.simulate import simulate

SECONDS = 8.0
HIDDEN = {
    "added_mass": {"diagonal": [20.0, 50.0, 60.0, 1.0, 5.0, 5.0]},
    "added_mass_coupling": {"M15": 10.0, "M24": -8.0, "M04": 3.0, "M13": -2.0, "M02": 5.0},
    "added_mass_coriolis": {"kappa": -0.5},
    "linear_damping": {"diagonal": [9.0, 8.0, 7.0, 1.0, 2.0, 3.0]},
    "quadratic_damping": {"diagonal": [30.0, 80.0, 90.0, 5.0, 6.0, 7.0]},
    "coupled_damping": {"D15": 3.0, "D51": 2.5, "D24": -2.0, "D42": -2.0, "D13": 1.0, "D31": -1.0},
    "crossflow_drag": {"Cd_y": 0.8, "Cd_z": 0.7},
    "cross_axis_drag": {
        "D01": 60.0,
        "D02": 90.0,
        "D10": 30.0,
        "D12": 80.0,
        "D21": 20.0,
        "D32": 9.0,
        "D51": 7.0,
    },
    "power_drag": {"diagonal": [30.0, 80.0, 90.0, 5.0, 6.0, 7.0], "n": 2.6},
    "offset_drag": {"drag": [60.0, 90.0, 120.0], "position": [-0.4, 0.2, 0.15]},
    "ellipsoid_drag": {"C": [0.4, 0.7, 0.9], "position": [0.05, -0.02, 0.03]},
    "control_surface": {
        "area": 0.06,
        "position": [-0.7, 0.1, -0.1],
        "roll": 0.4,
        "deflection": -0.1,
        "stall": 0.3,
    },
    "body_lift": {
        **{"L11": 100.0, "L15": -30.0, "L51": -30.0, "L55": 20.0},
        **{"L22": 60.0, "L24": 9.0, "L42": 8.0, "L44": 7.0},
    },
    "net_buoyancy": {"dB": 10.0},
    "buoyancy_offset": {"dx": 0.01, "dy": 0.005, "dz": 0.01},
    "payload": {"w": 15.0, "x": 0.4, "y": 0.1, "z": 0.1, "mass": 8.0},
    "ocean_current": {"v_N": 0.2, "v_E": -0.15, "v_D": 0.05},
    "current_shear": {"g_N": 0.08, "g_E": -0.05, "z_0": 3.5},
    "current_trend": {"a_N": 0.01, "a_E": -0.006, "t_0": 5.0},
    "drifting_ballast": {"S": [2.0, 1.0], "tilt": 0.2, "T": 1.5},
    "tether": {"k": 4.0, "slack": 1.0, "attachment": [-0.7, 0.0, 0.1], "anchor": [0.0, 1.0, 5.0]},
    "surface_suction": {"A": 30.0, "decay": 1.5},
    "fluid_memory": {"K": [[40.0, 80.0, 80.0, 3.0, 8.0, 8.0]], "rates": [0.8]},
    "thruster_gain": {"g": [0.1, 0.0, -0.4, 0.0, 0.2, 0.0, 0.0, 0.0]},
    "thruster_asymmetry": {"a": 0.25},
    "thruster_lag": {"dT": 0.12},
    "command_delay": {"d": 0.113},
    "thruster_deadband": {"d": 0.06},
    "thruster_curve": {"da": 0.7},
    "thruster_inflow": {"c": 0.15},
    "propeller_torque": {"k": [0.05, -0.04, 0.03, -0.05, 0.04, 0.03, -0.02, 0.05]},
    "sensor_scale": {"axes": [0.06, -0.03, 0.02]},
    "sensor_misalignment": {"alpha": [0.03, 0.02, 0.06]},
    "sensor_delay": {"d": 0.08},
    "sensor_lever_arm": {"r": [0.3, 0.1, -0.2]},
    "reference_point": {"r": [-0.2, 0.1, 0.3]},
    "sensor_bias": {"b": [0.04, -0.03, 0.02]},
}


def apart(vehicle, *hidden, depth=3.0):
    """Greatest difference of the two simulators over one session of steps, over all channels."""
    (flown,) = flights.independent(
        vehicle, vehicle, hidden, {}, rows=[round(SECONDS * 50)], depth=depth, noise=0.0, seed=3
    )
    full = vehicles.joined(vehicle, hidden)
    moving = tuple(table for table in full.effect if CATALOGUE[table["name"]].kind != "sensor")
    pose = sensor.true_pose(velocity_log(full), flown.select(POSE).to_numpy())
    at_rest = flown.with_columns(
        *(pl.Series(name, pose[:, i]) for i, name in enumerate(POSE)),
        *(pl.lit(0.0).alias(name) for name in VELOCITY),
    )
    again = (
        simulate(msgspec.structs.replace(full, effect=moving), at_rest).select(*POSE, *VELOCITY).to_numpy()
    )
    again[:, :6] = sensor.logged_pose(velocity_log(full), again[:, :6])
    again[:, 6:] = sensor.measured(velocity_log(full), flown["t"].to_numpy(), again[:, 6:])
    difference = flown.select(*POSE, *VELOCITY).to_numpy() - again
    difference[:, 3:6] = (difference[:, 3:6] + np.pi) % (2 * np.pi) - np.pi
    assert np.ptp(again, axis=0).max() > 1.0, "the vehicle has hardly moved"
    return np.abs(difference).max()


def test_every_effect_of_the_catalogue_is_tried():
    assert set(HIDDEN) == {
        name for name, effect in CATALOGUE.items() if not (effect.is_written or effect.is_random)
    }


@pytest.mark.parametrize("name", HIDDEN)
def test_each_effect_moves_the_vehicle_as_in_the_catalogue(name):
    tolerance = 5e-3 if name == "crossflow_drag" else 2e-4  # whose integral is another sum here
    assert apart(vehicles.preset("auv151"), {"name": name, **HIDDEN[name]}) < tolerance


def test_several_at_once_with_a_current():
    """What acts relative to the water and what does not are told apart."""
    names = ("ocean_current", "payload", "added_mass_coriolis", "body_lift", "fluid_memory")
    assert apart(vehicles.preset("auv151"), *({"name": name, **HIDDEN[name]} for name in names)) < 2e-4


@pytest.mark.parametrize("name", vehicles.PRESETS)
def test_each_vehicle_moves_as_its_file_says(name):
    assert apart(vehicles.preset(name)) < 5e-4


def energy(vehicle, states):
    """Kinetic energy with added mass, and potential energy of weight and buoyancy."""
    built = build.build(vehicle)
    total = 0.5 * np.einsum("ni,ij,nj->n", states[:, 7:], built.rigid + built.added, states[:, 7:])
    for k, state in enumerate(states):
        R = plant.turned(state[3:7])
        for force, *point in built.weights:
            total[k] -= force * (state[2] + R[2] @ np.array(point))
    return total


def test_without_damping_and_thrust_energy_is_kept():
    vehicle = msgspec.structs.replace(vehicles.preset("auv151"), effect=vehicles.preset("auv151").effect[:1])
    built = build.build(vehicle)
    first = np.zeros(plant.BODY)
    first[2:4], first[7:] = (5.0, 1.0), [0.8, 0.4, -0.3, 0.5, 0.4, 0.3]
    nothing = np.zeros((500, 6))
    states, commands = plant.fly(built, built, np.zeros((8, 6)), np.zeros((3, 2)), nothing, first, 0.02)
    assert not commands.any()
    total = energy(vehicle, states)
    assert np.abs(total - total[0]).max() < 1e-4 * 0.5 * (states[0, 7:] ** 2).sum() * 151


@pytest.mark.parametrize("number", range(8))
def test_what_the_catalogue_does_not_have_changes_the_motion(number):
    case = cases.draw("unknown", number)
    vehicle = vehicles.preset(case.preset)
    how = {"rows": [1500], "depth": case.depth, "noise": 0.0, "seed": 1}
    (with_it,) = flights.independent(vehicle, vehicle, (), case.foreign, **how)
    (without,) = flights.independent(vehicle, vehicle, (), {}, **how)
    difference = with_it.select(VELOCITY).to_numpy() - without.select(VELOCITY).to_numpy()
    assert 1e-3 < np.abs(difference).max() < 10.0
