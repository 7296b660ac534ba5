"""Correct names for each kind of change, and their aliases.

`benchmarks.judge.scores` defines how they count.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

FAULT = "log_fault"


@dataclass(frozen=True)
class Names:
    """Names of a kind of change.

    Attributes:
        right: Names of which each is right.
        alias: Names that count as neither right nor wrong, as their effect is a part of the change or nearly
            the same.
        why: Reason.
    """

    right: tuple[str, ...]
    alias: tuple[str, ...]
    why: str


OF_THRUST = "a share of thrust that is gone has one name, of whichever thruster"
BESIDE = "over the speeds flown, drag of another power of the speed fits nearly as well"
COLUMNS = "exactly the columns at fault"
NAMES: Mapping[str, Names] = {
    "current_steady": Names(
        ("ocean_current",),
        ("current_trend", "current_shear"),
        "what grows from far away is steady where the vehicle is",
    ),
    "current_shear": Names(
        ("current_shear",),
        ("ocean_current",),
        "a fit counts depth from where the recording is: the rest of a shear is a steady current",
    ),
    "current_time": Names(
        ("current_trend",),
        ("ocean_current",),
        "a fit counts time from where the recording is: the rest of a trend is a steady current",
    ),
    "payload": Names(
        ("payload",),
        ("net_buoyancy", "buoyancy_offset"),
        "its weight alone and its moment alone are parts of it",
    ),
    "float": Names(
        ("payload",),
        ("net_buoyancy", "buoyancy_offset"),
        "its lift alone and its moment alone are parts of it",
    ),
    "cg_shift": Names(
        ("buoyancy_offset",),
        ("payload",),
        "centres count by their distance; a load moves the centre of gravity, too",
    ),
    "trapped_water": Names(
        ("added_mass", "payload"),
        ("added_mass_coupling",),
        "mass without weight is added mass or a load without weight; off the origin, m x and m z couple axes",
    ),
    "net_buoyancy": Names(
        ("net_buoyancy",), ("payload",), "a load at the centre of buoyancy with little mass is the same"
    ),
    "thr_one": Names(("thruster_gain",), (), OF_THRUST),
    "thr_two": Names(("thruster_gain",), (), OF_THRUST),
    "thr_dead": Names(("thruster_gain",), (), OF_THRUST),
    "lag": Names(("thruster_lag",), (), "thrust that rises slowly is not thrust that comes late"),
    "delay": Names(("command_delay",), (), "thrust that comes late is not thrust that rises slowly"),
    "deadband": Names(("thruster_deadband",), (), "nothing else is cut off at small commands"),
    "curve": Names(("thruster_curve",), (), "nothing else bends thrust over the command"),
    "asymmetry": Names(("thruster_asymmetry",), (), "nothing else is weaker astern alone"),
    "added_mass": Names(
        ("added_mass",), ("payload",), "a load with mass and little weight is harder to accelerate, too"
    ),
    "linear": Names(("linear_damping",), ("quadratic_damping", "power_drag"), BESIDE),
    "quadratic": Names(
        ("quadratic_damping",),
        ("power_drag", "linear_damping", "cross_axis_drag", "crossflow_drag", "offset_drag"),
        f"{BESIDE}; at a point on its axis, or along one, it is the same drag",
    ),
    "appendage": Names(
        ("offset_drag",),
        ("quadratic_damping", "cross_axis_drag", "control_surface"),
        "its drag and its moment are parts of it, of axes or between them; a plate on an arm drags, too",
    ),
    "fin_trim": Names(("control_surface",), (), "a force across that grows with the speed ahead is a fin's"),
    "fin_lost": Names(
        ("control_surface", "body_lift"),
        ("coupled_damping",),
        "a fin of the file that is smaller, or the lift of hull and fins where the file has no fins; linear "
        "in sway and yaw at one speed",
    ),
    "tether": Names(("tether",), (), "nothing else pulls to a point"),
    "memory": Names(("fluid_memory",), ("added_mass",), "at the frequencies flown, most of it is added mass"),
    "inflow": Names(
        ("thruster_inflow",), ("linear_damping",), "at steady thrust the loss is in proportion to the speed"
    ),
    "suction": Names(("surface_suction",), ("net_buoyancy",), "at one depth a pull upwards is buoyancy"),
    "dvl_scale": Names(("sensor_scale",), (), "kinematics separates it from all forces"),
    "dvl_yaw": Names(("sensor_misalignment",), (), "kinematics separates it from all forces"),
    "dvl_late": Names(("sensor_delay",), (), "kinematics separates it from all forces"),
    "heading_bias": Names(
        (FAULT,),
        ("sensor_misalignment",),
        "heading and log are turned against one another; which of them is off shows in a current alone",
    ),
    "exchanged": Names((FAULT,), (), COLUMNS),
    "reversed": Names((FAULT,), (), COLUMNS),
    "unchanged": Names((), (), "there is nothing to name"),
}
"""Names of each kind of change of `changes.CHANGES`."""
