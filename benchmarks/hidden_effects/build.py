"""Conversion of a vehicle file and hidden effects to the parameters of the benchmark's own simulator."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.hidden_effects.parts import Parts, ellipsoid
from benchmarks.hidden_effects.plant import FOREIGN, Plant
from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE
from hydro.core.vehicle.description import Vehicle

PAIRS = {
    "added_mass_coupling": ("M15", "M24", "M04", "M13", "M02"),
    "coupled_damping": ("D15", "D51", "D24", "D42", "D13", "D31"),
}
FIN = ("roll", "deflection", "stall")
LIFTS = (("L11", "L15", "L51", "L55"), ("L22", "L24", "L42", "L44"))


def skew(r: Iterable[float]) -> Array:
    x, y, z = r
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rigid_body(mass: float, center: Iterable[float], inertia: Array) -> Array:
    """Return M_RB (6, 6) about the origin, given the inertia about the centre of gravity (Fossen 3.44)."""
    S = skew(center)
    return np.block([[mass * np.eye(3), -mass * S], [mass * S, inertia - mass * S @ S]])


def matrix(table: Mapping[str, Any]) -> Array:
    """Return the 6x6 matrix of an effect given by its diagonal or by all its entries."""
    return np.diag(table["diagonal"]) if "diagonal" in table else np.array(table["matrix"], float)


def build(
    vehicle: Vehicle,
    hidden: Iterable[Mapping[str, Any]] = (),
    foreign: Mapping[str, float] | None = None,
    laws: Iterable[Sequence[float]] = (),
) -> Plant:
    """Return a vehicle with hidden effects in the benchmark's own simulator.

    Args:
        vehicle: The vehicle file.
        hidden: `[[effect]]` tables in addition to those of the file.
        foreign: Values of effects outside the catalogue, by their name in `FOREIGN`.
        laws: Rows of `Plant.laws`.
    """
    body, hull = vehicle.rigid_body, vehicle.hull
    rho, gravity = vehicle.environment.water_density, vehicle.environment.gravity
    rigid = rigid_body(body.mass, body.center_of_gravity, np.array(body.inertia, float))
    added, linear = np.zeros((6, 6)), np.zeros((6, 6))
    across = np.zeros((6, 3))
    quadratic, drag, lift = np.zeros(6), np.zeros(2), np.zeros((2, 2, 2))
    buoyancy = np.array(vehicle.buoyancy.center, float)
    extra = [np.array([body.mass * gravity, *body.center_of_gravity])]
    kappa = lifted = asymmetry = lag = delay = band = curve = inflow = 0.0
    current, tether, suction, memory = np.zeros(3), np.zeros(8), np.zeros(2), np.zeros(7)
    gradient, trend, ballast = np.zeros(3), np.zeros(3), np.zeros(4)
    power, offset, fin = np.array([0.0] * 6 + [2.0]), np.zeros(6), np.zeros(7)
    form, faces = np.zeros(3), np.zeros((0, 6))
    gains, reactions = np.zeros(len(vehicle.thruster)), np.zeros(len(vehicle.thruster))
    for table in (*vehicle.effect, *hidden):
        get = table.get
        match table["name"]:
            case "added_mass":
                added += matrix(table)
            case "added_mass_coupling":
                for key in PAIRS["added_mass_coupling"]:
                    i, j = int(key[1]), int(key[2])
                    added[i, j] += get(key, 0.0)
                    added[j, i] += get(key, 0.0)
            case "added_mass_coriolis":
                kappa += table["kappa"]
            case "linear_damping":
                linear += matrix(table)
            case "coupled_damping":
                for key in PAIRS["coupled_damping"]:
                    linear[int(key[1]), int(key[2])] += get(key, 0.0)
            case "quadratic_damping":
                quadratic += table["diagonal"]
            case "cross_axis_drag":
                for key in (one for one in table if one.startswith("D")):
                    across[int(key[1]), int(key[2])] += table[key]
            case "crossflow_drag":
                drag += 0.5 * rho * np.array([get("Cd_y", 0.0) * hull.height, get("Cd_z", 0.0) * hull.width])
            case "body_lift":
                lift += [np.reshape([get(key, 0.0) for key in keys], (2, 2)) for keys in LIFTS]
            case "power_drag":
                power[:] = [*table["diagonal"], table["n"]]
            case "offset_drag":
                offset[:] = [*table["drag"], *table["position"]]
            case "ellipsoid_drag":
                form = 0.5 * rho * np.array(table["C"])
                half = 0.5 * np.array([hull.length, hull.width, hull.height])
                faces = ellipsoid(half, np.array(get("position", (0.0, 0.0, 0.0)), float))
            case "control_surface":
                fin[:] = [0.5 * rho * table["area"], *table["position"], *(get(k, 0.0) for k in FIN)]
            case "net_buoyancy":
                lifted += table["dB"]
            case "buoyancy_offset":
                buoyancy += [get("dx", 0.0), get("dy", 0.0), get("dz", 0.0)]
            case "payload":
                point = [get(axis, 0.0) for axis in "xyz"]
                extra.append(np.array([table["w"], *point]))
                rigid += rigid_body(get("mass", 0.0), point, np.zeros((3, 3)))
            case "ocean_current":
                current += [get(axis, 0.0) for axis in ("v_N", "v_E", "v_D")]
            case "current_shear":
                gradient[:] = [get(key, 0.0) for key in ("g_N", "g_E", "z_0")]
            case "current_trend":
                trend[:] = [get(key, 0.0) for key in ("a_N", "a_E", "t_0")]
            case "drifting_ballast":
                ballast[:] = [*(gravity * np.array(table["S"])), table["tilt"], table["T"]]
            case "tether":
                attachment = get("attachment", (0.0, 0.0, 0.0))
                tether[:] = [table["k"], get("slack", 0.0), *attachment, *table["anchor"]]
            case "surface_suction":
                suction[:] = table["A"], table["decay"]
            case "fluid_memory":
                memory[:] = [*table["K"][0], table["rates"][0]]
            case "thruster_gain":
                gains += table["g"]
            case "thruster_asymmetry":
                asymmetry += table["a"]
            case "thruster_lag":
                lag += table["dT"]
            case "command_delay":
                delay += table["d"]
            case "thruster_deadband":
                band += table["d"]
            case "thruster_curve":
                curve += table["da"]
            case "thruster_inflow":
                inflow += table["c"]
            case "propeller_torque":
                reactions += table["k"]
            case name if CATALOGUE[str(name)].kind != "sensor":
                raise ValueError(f"the benchmark's simulator has no {name}")
    extra.append(np.array([-vehicle.buoyancy.force, *buoyancy]))
    return Plant(
        rigid=rigid,
        added=added,
        inverse=np.linalg.inv(rigid + added),
        kappa=float(kappa),
        weights=np.array(extra),
        lifted=np.array([lifted, *buoyancy]),
        linear=linear,
        quadratic=quadratic,
        across=across,
        drag=drag,
        span=np.array([hull.length, hull.center[0]]),
        lift=lift,
        current=current,
        gradient=gradient,
        trend=np.array([*trend, vehicle.buoyancy.force / gravity]),
        ballast=ballast,
        tether=tether,
        suction=np.array([*suction, *buoyancy]),
        memory=memory,
        parts=Parts(power, offset, fin, form, faces),
        thrusts=np.array([[*t.direction, *np.cross(t.position, t.direction)] for t in vehicle.thruster]),
        reactions=reactions,
        limits=np.array([[t.max_thrust, t.max_reverse_thrust] for t in vehicle.thruster]),
        chains=np.array(
            [
                [
                    (2.0 if t.curve == "quadratic" else 1.0) + curve,
                    t.lag == "speed",
                    _time_constant(t.time_constant + lag, t.lag_step),
                    t.deadband + band,
                    t.deadband_style == "shift",
                ]
                for t in vehicle.thruster
            ],
            float,
        ),
        gains=gains,
        asymmetry=float(asymmetry),
        inflow=float(inflow),
        delay=float(delay + vehicle.thruster[0].delay),
        foreign=np.array([float((foreign or {}).get(name, 0.0)) for name in FOREIGN]),
        laws=np.array([*laws], float).reshape(-1, 8),
    )


def _time_constant(constant: float, step: float | None) -> float:
    """Return the time constant [s] of the exact lag that equals a lag integrated by Euler steps.

    Args:
        constant: Time constant of the lag [s].
        step: Length of the Euler steps [s]; None for an exact lag.
    """
    return -step / np.log1p(-step / constant) if step else constant
