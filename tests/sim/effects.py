"""Vehicles with effects, commands and a state, shared by the tests of the MuJoCo model."""

from __future__ import annotations

from functools import cache

import msgspec
import numpy as np

from hydro.io import vehicle as vehicle_file

ROWS, DT = 250, 0.02

EFFECTS = {
    "added_mass": {"matrix": (np.diag([80.0, 150, 160, 4, 14, 12]) + 0.5 * np.ones((6, 6))).tolist()},
    "added_mass_coupling": {"M15": 6.0, "M24": -5.0, "M04": 2.0, "M13": 1.0, "M02": 3.0},
    "added_mass_coriolis": {"kappa": -0.6},
    "linear_damping": {"diagonal": [10.0, 40.0, 50.0, 6.0, 9.0, 8.0]},
    "quadratic_damping": {"diagonal": [50.0, 100.0, 120.0, 9.0, 12.0, 11.0]},
    "coupled_damping": {"D15": 5.0, "D51": 4.0, "D24": -3.0, "D42": -4.0, "D13": 1.0, "D31": 2.0},
    "crossflow_drag": {"Cd_y": 1.1, "Cd_z": 0.8},
    "cross_axis_drag": {"D01": 60.0, "D02": 90.0, "D10": 30.0, "D12": 80.0, "D20": 20.0, "D32": 9.0},
    "power_drag": {"diagonal": [40.0, 90.0, 110.0, 8.0, 11.0, 10.0], "n": 1.5},
    "offset_drag": {"drag": [40.0, 60.0, 90.0], "position": [-0.4, 0.15, 0.2]},
    "ellipsoid_drag": {"C": [0.6, 0.9, 1.1], "position": [0.02, 0.01, -0.03]},
    "control_surface": {"area": 0.05, "position": [-0.6, 0.1, -0.1], "roll": 0.3, "deflection": 0.1,
                        "stall": 0.4, "commands": ["c2", "c1"], "turn": [0.3, -0.2]},
    "body_lift": {"L11": 40.0, "L15": 9, "L51": 8, "L55": 5, "L22": 30, "L24": 9, "L42": 7, "L44": 6},
    "net_buoyancy": {"dB": -7.0},
    "buoyancy_offset": {"dx": 0.02, "dy": -0.01, "dz": 0.03},
    "payload": {"w": 12.0, "x": 0.3, "y": 0.1, "z": 0.2, "mass": 5.0},
    "ocean_current": {"v_N": 0.3, "v_E": -0.2, "v_D": 0.1},
    "current_shear": {"g_N": 0.1, "g_E": -0.06, "z_0": 1.0},
    "current_trend": {"a_N": 0.05, "a_E": -0.03, "t_0": 1.0},
    "drifting_ballast": {"S": [1.5, 0.8], "tilt": 0.2, "T": 0.7},
    "tether": {"k": 30.0, "slack": 0.5, "attachment": [-0.5, 0.0, 0.1], "anchor": [1.0, 1.0, 0.0]},
    "surface_suction": {"A": 20.0, "decay": 1.5},
    "fluid_memory": {"K": [[20.0, 50, 60, 2, 6, 5], [5.0, 9, 8, 1, 2, 1]], "rates": [1.0, 6.0]},
    "thruster_gain": {"g": [-0.3, 0.1, 0.0, 0.2, 0.0, -0.1, 0.05, 0.0]},
    "thruster_asymmetry": {"a": 0.25},
    "thruster_lag": {"dT": 0.08},
    "command_delay": {"d": 0.06},
    "thruster_deadband": {"d": 0.04},
    "thruster_curve": {"da": 0.6},
    "thruster_inflow": {"c": 0.2},
    "formula": {
        "forces": ["X |u|^n sgn(u)", "Y |w| v", "Z c2 |c2|"], "force": [-30.0, -20.0, 15.0],
        "moments": ["K g_y", "N c1 u"], "moment": [-3.0, 2.0], "exponents": [1.6],
    },
    "propeller_torque": {"k": [0.03, -0.03, 0.02, -0.04, 0.05, -0.05, 0.03, 0.02]},
}  # fmt: skip


@cache
def preset(datasets, name):
    return vehicle_file.read(datasets / "vehicles" / f"{name}.toml")[0]


def with_effect(vehicle, name):
    table = {"name": name, **EFFECTS[name]}
    for each in {"g", "k"} & set(table):
        if isinstance(table[each], list) and name != "tether":
            table[each] = table[each][: len(vehicle.thruster)]
    if name == "added_mass_coupling":  # as much of a small vehicle's inertia as of a large one's
        share = min(1.0, vehicle.rigid_body.mass / 151.0)
        table = {key: value if key == "name" else share * value for key, value in table.items()}
    kept = tuple(e for e in vehicle.effect if e["name"] != name)
    return msgspec.structs.replace(vehicle, effect=(*kept, table))


def commands(thrusters, rows=ROWS, seed=0):
    """Return smooth commands with a jump in each channel."""
    rng = np.random.default_rng(seed)
    t = np.arange(rows) * DT
    waves = 0.4 * np.sin(
        2 * np.pi * rng.uniform(0.1, 0.6, thrusters) * t[:, None] + rng.uniform(0, 6, thrusters)
    )
    jumps = 0.4 * rng.normal(size=thrusters) * (t[:, None] > rng.uniform(0.5, 4.0, thrusters))
    return waves + jumps


ETA = np.array([2.0, -1.0, 1.2, 0.2, -0.3, 1.0])
NU = np.array([0.6, -0.3, 0.2, 0.15, -0.2, 0.25])
