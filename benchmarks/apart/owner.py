"""Owner's file of a vehicle: stated data, and effects with random errors.

Drag is linear and quadratic from the true hull, axis by axis, as from a towing tank; then every number gets a
random error.  No file describes additional forces of bars, strips and fins.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.apart.frames import Array
from benchmarks.apart.hulls import HULLS
from benchmarks.apart.vehicles import Vehicle

TOWED = {
    "rov": np.array([0.7, 0.5, 0.4, 0.6, 0.6, 0.8]),
    "hover": np.array([0.8, 0.35, 0.3, 0.4, 0.3, 0.4]),
    "torpedo": np.array([1.2, 0.3, 0.3, 0.6, 0.4, 0.4]),
}
"""Greatest speed on each axis at which drag is measured [m/s, rad/s]."""
QUARTER = 1.570796
"""Quarter of a turn [rad], with the digits of a file."""
Effect = tuple[str, list[tuple[str, str]]]


def number(x: Any) -> str:
    """Return a number as TOML, rounded to 1e-6."""
    return repr(round(float(x), 6))


def array(x: Any) -> str:
    """Return numbers as TOML, rounded to 1e-6."""
    return "[" + ", ".join(number(v) for v in np.ravel(x)) + "]"


def drag(vehicle: Vehicle) -> tuple[Array, Array]:
    """Fit linear and quadratic damping (6,) of every axis alone to towing speeds by least squares."""
    one = {k: np.asarray(v, float)[None] for k, v in vehicle.P.items()}
    linear, quadratic = np.zeros(6), np.zeros(6)
    for i in range(6):
        s = np.linspace(0.1, 1, 10) * TOWED[vehicle.kind][i]
        f = [-HULLS[vehicle.kind](one, np.asarray(np.eye(6)[i] * v, float)[None])[0][i] for v in s]
        if vehicle.kind == "torpedo":
            quadratic[i] = np.sum(s * s * f) / np.sum(s**4)
            continue
        c = np.linalg.lstsq(np.stack([s, s * s], 1), f, rcond=None)[0]
        linear[i], quadratic[i] = max(c[0], 0), max(c[1], 0)
        if c[0] < 0:
            quadratic[i] = np.sum(s * s * f) / np.sum(s**4)
    return linear, quadratic


def effects(vehicle: Vehicle, rng: np.random.Generator, spread: float) -> list[Effect]:
    """Return the effects of the vehicle file, each as name and keys.

    Args:
        vehicle: The true vehicle.
        rng: Random generator of the errors.
        spread: Standard deviation of the logarithm of each number's random factor.
    """

    def wrong(count: int) -> Array:
        return np.exp(rng.normal(0, spread, count))

    P = vehicle.P
    L, Wd, H = vehicle.box
    linear, quadratic = drag(vehicle)
    told: list[Effect] = [("added_mass", [("diagonal", array(np.diag(P["Ma"]) * wrong(6)))])]
    if vehicle.kind == "torpedo":
        return told + _slender(vehicle, quadratic, wrong)
    cy = cz = 0.0
    if vehicle.kind == "hover":  # cross-flow drag takes most of sway and heave
        cy, cz = quadratic[1] / (0.5 * P["rho"] * L * H), quadratic[2] / (0.5 * P["rho"] * L * Wd)
        quadratic *= np.array([1.0, 0.3, 0.3, 1.0, 0.4, 0.4])
    told.append(("linear_damping", [("diagonal", array(linear * wrong(6)))]))
    told.append(("quadratic_damping", [("diagonal", array(quadratic * wrong(6)))]))
    if vehicle.kind == "hover":
        keys = [("Cd_y", number(0.7 * cy * wrong(1)[0])), ("Cd_z", number(0.7 * cz * wrong(1)[0]))]
        told.append(("crossflow_drag", keys))
    return told


def _slender(vehicle: Vehicle, quadratic: Array, wrong: Any) -> list[Effect]:
    """Return the effects in the file of a torpedo: couplings, drag of strips, lift of the hull, movable fins.

    Args:
        vehicle: The true vehicle.
        quadratic: Quadratic damping of each axis (6,).
        wrong: Function that returns a number with a random error.
    """
    P, fin = vehicle.P, vehicle.fin
    coupling = [("M15", number(P["Ma"][1, 5] * wrong(1)[0])), ("M24", number(P["Ma"][2, 4] * wrong(1)[0]))]
    told: list[Effect] = [("added_mass_coupling", coupling)]
    q = quadratic * wrong(6)
    q[1] = q[2] = 0
    q[3] = max(q[3], 1e-3)
    q[4] *= 0.6
    q[5] *= 0.6
    told.append(("quadratic_damping", [("diagonal", array(q))]))
    cd = 0.5 * (P["cd_hi"] + P["cd_lo"]) * 0.85
    told.append(("crossflow_drag", [("Cd_y", number(cd * wrong(1)[0])), ("Cd_z", number(cd * wrong(1)[0]))]))
    k, x = float(P["klift"]), float(P["x_lift"])
    L11, L15, L55 = k, k * x, k * x * x
    if not vehicle.driven:  # fixed fins are in the body's lift
        ka = 0.5 * P["rho"] * P["cla"] * 2 * P["fin_area"][0]
        L11, L15, L55 = k + ka, k * x + ka * fin["x"], k * x * x + ka * fin["x"] ** 2
    w = wrong(1)[0]
    lift = {"L11": L11, "L15": L15, "L51": L15, "L55": L55, "L22": L11, "L24": -L15, "L42": -L15, "L44": L55}
    told.append(("body_lift", [(key, number(value * w)) for key, value in lift.items()]))
    if vehicle.driven:
        for command, roll in ((2, 0.0), (3, QUARTER)):
            area = number(2 * fin["area"] * wrong(1)[0] ** 0.5)
            turn = f"[{number(vehicle.turn * (1 if command == 2 else -1))}]"
            keys = [("commands", f'["c{command}"]'), ("area", area), ("position", array([fin["x"], 0, 0]))]
            keys += [("roll", number(roll)), ("stall", number(fin["stall"])), ("turn", turn)]
            told.append(("control_surface", keys))
    return told


def file(
    vehicle: Vehicle, name: str, told: Sequence[Effect], rng: np.random.Generator, sloppy: float = 0.02
) -> str:
    """Return the text of the vehicle file, with one random factor 1 +- `sloppy` on the inertia.

    Args:
        vehicle: The true vehicle.
        name: Name in the file.
        told: Effects of the file.
        rng: Random generator.
        sloppy: Greatest relative error of the inertia.
    """
    P = vehicle.P
    L, Wd, H = vehicle.box
    inertia = P["I"] * (1 + rng.normal(0, sloppy))
    lines = ['format = "hydro-vehicle/1"', f'name = "{name}"', ""]
    lines += ["[environment]", f"water_density = {number(P['rho'])}", "gravity = 9.81", ""]
    lines += ["[rigid_body]", f"mass = {number(P['mass'])}", f"center_of_gravity = {array(P['cg'])}"]
    lines += ["inertia = [" + ", ".join(array(row) for row in inertia) + "]", ""]
    lines += ["[buoyancy]", f"force = {number(P['buoy'])}", f"center = {array(P['cb'])}", ""]
    lines += ["[hull]", f"length = {number(L)}", f"width = {number(Wd)}", f"height = {number(H)}", ""]
    for i in range(vehicle.n):
        lines += ["[[thruster]]"]
        if i in vehicle.fin_commands:
            lines += [f'name = "{"elevator" if i == 1 else "rudder"}"', 'curve = "none"', ""]
            continue
        lines += [f'name = "T{i + 1}"', f"position = {array(P['thr_pos'][i])}"]
        lines += [f"direction = {array(P['thr_dir'][i])}", f"max_thrust = {number(P['thr_max'][i])}"]
        lines += [f"max_reverse_thrust = {number(P['thr_max_rev'][i])}"]
        lines += [f'curve = "{"linear" if P["thr_pow"][i] == 1 else "quadratic"}"', 'lag = "thrust"']
        lines += [f"time_constant = {number(P['thr_tau'][i])}", f"deadband = {number(P['thr_db'][i])}"]
        lines += ['deadband_style = "cut"', ""]
    for effect, keys in told:
        lines += ["[[effect]]", f'name = "{effect}"'] + [f"{key} = {value}" for key, value in keys] + [""]
    return "\n".join(lines)
