"""Step responses of the preset `remus100_fins`, compared with the equations of Prestero's thesis (2001).

The reference is not a measurement of the thesis.  It is an independent simulation of its equations of motion
with its coefficients, by scipy's `solve_ivp`, and shares no code with hydro.  The coefficients agree with a
public implementation, REMUS.m of github.com/ArizaWilmerUTAS/Path-Following, which lists them too.

Both vehicles begin in the same straight and level run at 1.54 m/s, trimmed by the stern planes against 7 N of
net buoyancy.  Then one command steps.  The thesis prints Y_vv = -1310, ten times Z_ww of the same round hull.
The reference and the preset use -131.  A column has the reference with the printed value.

    python -m benchmarks.remus_steps --keep COMMIT
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import polars as pl
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from benchmarks.kept_tables import Row, keep, markdown, origin
from hydro.core.columns import Array
from hydro.core.effects import assemble
from hydro.core.simulation.simulate import trajectory
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files
from hydro.io.files import bundled

DT = 0.02
"""Interval of the rows [s]."""
CRUISE, THRUST, TORQUE = 1.54, 3.86, -0.543
"""Speed [m/s], propeller thrust [N] and torque [N m] of the thesis."""
FULL_FIN = math.radians(13.6)
"""Greatest deflection of a fin [rad]."""
FULL_THRUST = 10.0
"""Thrust of the preset at full command [N]."""
TURN_SECONDS, DIVE_SECONDS = 40.0, 10.0
RUDDERS, PLANES = (2.0, 4.0, 8.0, 13.6), (-4.0, 4.0)
"""Steps of the rudder and of the stern planes from trim [deg]."""

COEFFICIENTS: Mapping[str, float] = {
    "W": 299.0, "B": 306.0, "m": 30.48, "zg": 0.0196, "Ixx": 0.177, "Iyy": 3.45, "Izz": 3.45,
    "Xuu": -1.62, "Xudot": -0.93, "Xwq": -35.5, "Xqq": -1.93, "Xvr": 35.5, "Xrr": -1.93,
    "Yvv": -131.0, "Yrr": 0.632, "Yuv": -28.6, "Yvdot": -35.5, "Yrdot": 1.93, "Yur": 5.22, "Ywp": 35.5,
    "Ypq": 1.93, "Yuudr": 9.64,
    "Zww": -131.0, "Zqq": -0.632, "Zuw": -28.6, "Zwdot": -35.5, "Zqdot": -1.93, "Zuq": -5.22, "Zvp": -35.5,
    "Zrp": 1.93, "Zuuds": -9.64,
    "Kpp": -0.13, "Kpdot": -0.0704,
    "Mww": 3.18, "Mqq": -188.0, "Muw": 24.0, "Mwdot": -1.93, "Mqdot": -4.88, "Muq": -2.0, "Mvp": -1.93,
    "Mrp": 4.86, "Muuds": -6.15,
    "Nvv": -3.18, "Nrr": -94.0, "Nuv": -24.0, "Nvdot": 1.93, "Nrdot": -4.88, "Nur": -2.0, "Nwp": -1.93,
    "Npq": -4.86, "Nuudr": -6.15,
}  # fmt: skip
"""Coefficients of the thesis, SI units; Y_vv as explained above."""
PRINTED = {"Yvv": -1310.0}


class Start(NamedTuple):
    """Straight and level run.

    Attributes:
        pitch: Pitch angle [rad].
        surge: u [m/s].
        heave: w [m/s].
        planes: Deflection of the stern planes [rad].
        thrust: Propeller thrust [N].
    """

    pitch: float
    surge: float
    heave: float
    planes: float
    thrust: float


@dataclass(frozen=True)
class Thesis:
    """Equations of motion of the thesis.

    Attributes:
        c: Coefficients by name.
    """

    c: Mapping[str, float]

    def forces(self, angles: Array, nu: Array, rudder: float, planes: float, thrust: float) -> Array:
        """Return the right-hand side (6,) [N, N m] at phi, theta, psi and nu (6,)."""
        u, v, w, p, q, r = nu
        phi, theta, _ = angles
        c = self.c
        m, zg, net = c["m"], c["zg"], c["W"] - c["B"]
        x = (
            -net * math.sin(theta) + c["Xuu"] * u * abs(u) + (c["Xwq"] - m) * w * q + c["Xqq"] * q * q
            + (c["Xvr"] + m) * v * r + c["Xrr"] * r * r - m * zg * p * r + thrust
        )  # fmt: skip
        y = (
            net * math.cos(theta) * math.sin(phi) + c["Yvv"] * v * abs(v) + c["Yrr"] * r * abs(r)
            + c["Yuv"] * u * v + (c["Ywp"] + m) * w * p + (c["Yur"] - m) * u * r - m * zg * q * r
            + c["Ypq"] * p * q + c["Yuudr"] * u * u * rudder
        )  # fmt: skip
        z = (
            net * math.cos(theta) * math.cos(phi) + c["Zww"] * w * abs(w) + c["Zqq"] * q * abs(q)
            + c["Zuw"] * u * w + (c["Zuq"] + m) * u * q + (c["Zvp"] - m) * v * p + m * zg * (p * p + q * q)
            + c["Zrp"] * r * p + c["Zuuds"] * u * u * planes
        )  # fmt: skip
        k = (
            -zg * c["W"] * math.cos(theta) * math.sin(phi) + c["Kpp"] * p * abs(p)
            - (c["Izz"] - c["Iyy"]) * q * r + m * zg * (u * r - w * p) + TORQUE / THRUST * thrust
        )  # fmt: skip
        pitching = (
            -zg * c["W"] * math.sin(theta) + c["Mww"] * w * abs(w) + c["Mqq"] * q * abs(q)
            + (c["Mrp"] - (c["Ixx"] - c["Izz"])) * r * p + m * zg * (v * r - w * q) + c["Muq"] * u * q
            + c["Muw"] * u * w + c["Mvp"] * v * p + c["Muuds"] * u * u * planes
        )  # fmt: skip
        n = (
            c["Nvv"] * v * abs(v) + c["Nrr"] * r * abs(r) + c["Nuv"] * u * v
            + (c["Npq"] - (c["Iyy"] - c["Ixx"])) * p * q + c["Nwp"] * w * p + c["Nur"] * u * r
            + c["Nuudr"] * u * u * rudder
        )  # fmt: skip
        return np.array([x, y, z, k, pitching, n])

    def inertia(self) -> Array:
        """Return the matrix of the accelerations (6, 6)."""
        c = self.c
        m, lever = c["m"], c["m"] * c["zg"]
        return np.array(
            [
                [m - c["Xudot"], 0, 0, 0, lever, 0],
                [0, m - c["Yvdot"], 0, -lever, 0, -c["Yrdot"]],
                [0, 0, m - c["Zwdot"], 0, -c["Zqdot"], 0],
                [0, -lever, 0, c["Ixx"] - c["Kpdot"], 0, 0],
                [lever, 0, -c["Mwdot"], 0, c["Iyy"] - c["Mqdot"], 0],
                [0, -c["Nvdot"], 0, 0, 0, c["Izz"] - c["Nrdot"]],
            ]
        )

    def trimmed(self) -> Start:
        """Return the straight and level run at the cruising speed."""

        def left(guess: Array) -> Array:
            pitch, planes, thrust = guess
            nu = np.array([CRUISE * math.cos(pitch), 0.0, CRUISE * math.sin(pitch), 0.0, 0.0, 0.0])
            return self.forces(np.array([0.0, pitch, 0.0]), nu, 0.0, planes, thrust)[[0, 2, 4]]

        pitch, planes, thrust = fsolve(left, [0.0, 0.0, THRUST])
        return Start(pitch, CRUISE * math.cos(pitch), CRUISE * math.sin(pitch), planes, thrust)

    def fly(self, start: Start, rudder: float, planes: float, seconds: float) -> Array:
        """Return the motion (N, 12) x ... psi, u ... r after a step of the fins [rad]."""
        inverse = np.linalg.inv(self.inertia())

        def rate(t: float, state: Array) -> Array:
            angles, nu = state[3:6], state[6:]
            moved = np.concatenate([rotation(*angles) @ nu[:3], euler_rates(*angles[:2]) @ nu[3:]])
            force = self.forces(angles, nu, rudder, start.planes + planes, start.thrust)
            return np.concatenate([moved, inverse @ force])

        t = np.arange(round(seconds / DT) + 1) * DT
        begin = np.array([0, 0, 0, 0, start.pitch, 0, start.surge, 0, start.heave, 0, 0, 0], float)
        solved = solve_ivp(rate, (0.0, t[-1]), begin, t_eval=t, rtol=1e-8, atol=1e-9)
        return np.asarray(solved.y.T)


def rotation(phi: float, theta: float, psi: float) -> Array:
    """Return the rotation (3, 3) from the body to NED for ZYX angles [rad]."""
    cx, sx, cy, sy, cz, sz = (f(a) for a in (phi, theta, psi) for f in (math.cos, math.sin))
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    return np.asarray(about_z @ about_y @ about_x)


def euler_rates(phi: float, theta: float) -> Array:
    """Return the matrix (3, 3) from p, q, r to the rates of the ZYX angles."""
    sine, cosine = math.sin(phi), math.cos(phi)
    tangent, secant = math.tan(theta), 1.0 / math.cos(theta)
    return np.array(
        [[1, sine * tangent, cosine * tangent], [0, cosine, -sine], [0, sine * secant, cosine * secant]]
    )


def preset() -> Vehicle:
    """Return the preset."""
    return files.read(bundled("vehicles") / "remus100_fins.toml")[0]


def flown(vehicle: Vehicle, start: Start, rudder: float, planes: float, seconds: float) -> Array:
    """Return the motion (N, 12) of the preset after a step of the fins [rad]."""
    t = np.arange(round(seconds / DT) + 1) * DT
    speed = math.sqrt(start.thrust / FULL_THRUST)
    row = [speed, rudder / FULL_FIN, (start.planes + planes) / FULL_FIN]
    return trajectory(
        assemble(vehicle),
        np.tile(row, (len(t), 1)),
        t,
        eta=[0.0, 0.0, 0.0, 0.0, start.pitch, 0.0],
        nu=[start.surge, 0.0, start.heave, 0.0, 0.0, 0.0],
        settled=True,
    )


def turn_figures(motion: Array) -> dict[str, float]:
    """Return figures of a turn by name: yaw rate, speed and radius in the last ten seconds, and rise time.

    Args:
        motion: Pose and velocity at N rows of DT [s], (N, 12).
    """
    yaw = np.unwrap(motion[:, 5])
    rate, last = np.gradient(yaw, DT), round(10.0 / DT)
    steady = float(rate[-last:].mean())
    speed = float(np.linalg.norm(motion[-last:, 6:8], axis=1).mean())
    rise = float(np.argmax(rate / steady >= 0.63) * DT)
    return {
        "steady yaw rate [deg/s]": math.degrees(steady),
        "turning radius [m]": speed / abs(steady),
        "speed in the turn [m/s]": speed,
        "63 % of the yaw rate after [s]": rise,
    }


def dive_figures(motion: Array) -> dict[str, float]:
    """Return figures of a dive or climb by name: pitch and depth after the step."""
    at = round(5.0 / DT)
    return {
        "pitch after 5 s [deg]": math.degrees(motion[at, 4]),
        "pitch after 10 s [deg]": math.degrees(motion[-1, 4]),
        "depth change after 5 s [m]": float(motion[at, 2]),
        "depth change after 10 s [m]": float(motion[-1, 2]),
    }


def rows() -> list[Row]:
    """Return one row per manoeuvre and figure: equations of the thesis, preset, difference."""
    thesis, printed, vehicle = Thesis(COEFFICIENTS), Thesis({**COEFFICIENTS, **PRINTED}), preset()
    start, found = thesis.trimmed(), []
    steps = [(f"rudder {degrees:g}°", math.radians(degrees), 0.0) for degrees in RUDDERS]
    steps += [(f"stern planes {degrees:+g}° from trim", 0.0, math.radians(degrees)) for degrees in PLANES]
    for manoeuvre, rudder, planes in steps:
        figures, seconds = (turn_figures, TURN_SECONDS) if rudder else (dive_figures, DIVE_SECONDS)
        found += compared(
            manoeuvre,
            figures(thesis.fly(start, rudder, planes, seconds)),
            figures(printed.fly(start, rudder, planes, seconds)),
            figures(flown(vehicle, start, rudder, planes, seconds)),
        )
    return found


def compared(
    manoeuvre: str, expected: Mapping[str, float], printed: Mapping[str, float], actual: Mapping[str, float]
) -> list[Row]:
    """Return the rows of one manoeuvre, with the difference between preset and equations of the thesis.

    Args:
        manoeuvre: Name of the manoeuvre.
        expected: Figures of the equations, with the corrected coefficient.
        printed: Figures of the equations, with the printed coefficient.
        actual: Figures of the preset.
    """
    return [
        {
            "manoeuvre": manoeuvre,
            "figure": name,
            "equations of the thesis": f"{value:.3g}",
            "preset": f"{actual[name]:.3g}",
            "difference [%]": f"{100.0 * (actual[name] - value) / abs(value):+.1f}",
            "equations with Y_vv as printed": f"{printed[name]:.3g}",
        }
        for name, value in expected.items()
    ]


def main(arguments: list[str] | None = None) -> None:
    """Print the table, and keep it with `--keep`."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--keep", metavar="COMMIT", help="keep the table as measured with this commit")
    given = parser.parse_args(arguments)
    table = rows()
    print(markdown(table))
    if given.keep:
        command = "python -m benchmarks.remus_steps"
        source = origin(pl.DataFrame({"seed": [0]}), command, given.keep) | {"seeds": ""}
        keep("remus_steps", [row | source for row in table])


if __name__ == "__main__":
    main()
