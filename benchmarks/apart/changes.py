"""Changes of a vehicle, its water or its log: one function per kind.

A function draws from its generator in the same order for any size, so that a larger case differs in size
alone.  It changes the parameters of a `Draw` in place and returns the truth in SI units, body frame FRD or
world NED as stated.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.apart.frames import Array, G, rigid_body
from benchmarks.apart.hulls import resistance
from benchmarks.apart.vehicles import Parameters, Vehicle

SPEEDS = {
    "rov": np.array([0.7, 0.5, 0.4, 0.6, 0.6, 0.8]),
    "hover": np.array([0.8, 0.35, 0.3, 0.4, 0.3, 0.4]),
    "torpedo": np.array([1.3, 0.3, 0.3, 0.6, 0.4, 0.4]),
}
"""Speed on each axis for which the size of added drag is chosen [m/s, rad/s]."""
MIDDLE = 20.0
"""Mean depth of sessions [m]."""
Truth = dict[str, Any]


@dataclass(frozen=True)
class Draw:
    """Source of a random change.

    Attributes:
        vehicle: The unchanged vehicle.
        Q: Parameters of the changed vehicle, a copy that a change may alter.
        rng: Random generator of the case.
        s: Factor on the size of the change, 1 at first.
    """

    vehicle: Vehicle
    Q: Parameters
    rng: np.random.Generator
    s: float

    @property
    def P(self) -> Parameters:
        """Return the parameters of the unchanged vehicle."""
        return self.vehicle.P

    @property
    def slender(self) -> bool:
        """Return whether the vehicle is a torpedo, which is sensitive to small changes."""
        return self.vehicle.kind == "torpedo"

    @property
    def weight(self) -> float:
        """Return the weight of the vehicle [N]."""
        return self.P["mass"] * G

    def between(self, low: float, high: float) -> float:
        """Draw a number between two bounds."""
        return self.rng.uniform(low, high)

    def sized(self, low: float, high: float) -> float:
        """Draw a number between two bounds, times the factor on the size of the change."""
        return self.s * self.rng.uniform(low, high)

    def sign(self) -> float:
        """Draw -1 or 1."""
        return self.rng.choice([-1.0, 1.0])

    def heading(self) -> float:
        """Draw a direction [rad]."""
        return self.rng.uniform(-np.pi, np.pi)

    def axis(self, *slender: int) -> int:
        """Draw surge, sway, heave or yaw; for a torpedo, one of the given axes."""
        return int(self.rng.choice(slender if self.slender else [0, 1, 2, 5]))

    def resistance(self) -> tuple[Array, Array]:
        """Return the hull force per axis (6,) [N, N m], and the speeds at which it acts [m/s, rad/s]."""
        speeds = SPEEDS[self.vehicle.kind]
        return resistance(self.P, self.vehicle.kind, speeds), speeds


def current_steady(d: Draw) -> Truth:
    """Add a steady current of 0.12 to 0.25 m/s."""
    a, v = d.heading(), d.sized(0.12, 0.25)
    d.Q["vc"] = np.array([v * np.cos(a), v * np.sin(a), 0.0])
    return {"vc": d.Q["vc"]}


def current_shear(d: Draw) -> Truth:
    """Add a current with a shear of 0.03 to 0.06 1/s below a depth near the middle."""
    a, g = d.heading(), d.sized(0.03, 0.06)
    d.Q["shear"] = g * np.array([np.cos(a), np.sin(a)])
    d.Q["shear_z0"] = MIDDLE + d.between(-4, 4)
    return {"shear": d.Q["shear"], "z0": d.Q["shear_z0"]}


def current_time(d: Draw) -> Truth:
    """Add a current that increases by 3 to 6 mm/s^2 from some time of a session."""
    a, g = d.heading(), d.sized(0.003, 0.006)
    d.Q["trend"] = g * np.array([np.cos(a), np.sin(a)])
    d.Q["trend_t0"] = d.between(0, 70)
    return {"trend": d.Q["trend"], "t0": d.Q["trend_t0"]}


def payload(d: Draw) -> Truth:
    """Add a weight, with its mass, at a random place on the hull."""
    return _load(d, 1)


def float_(d: Draw) -> Truth:
    """Add a float, with its mass, at a random place on the hull."""
    return _load(d, -1)


def _load(d: Draw, sign: int) -> Truth:
    """Add a load of 1.2 to 2.5 % of the weight, half of that on a torpedo."""
    L, Wd, H = d.vehicle.box
    w = sign * d.sized(0.012, 0.025) * d.weight * (0.5 if d.slender else 1)
    x, y = d.between(0.15, 0.4) * d.sign() * L, d.between(0.0, 0.3) * d.sign() * Wd
    r = np.array([x, y, d.between(-0.4, 0.4) * H])
    m = (abs(w) / G * d.between(1.2, 1.8)) if w > 0 else abs(w) / G * 0.5
    d.Q["pay_w"], d.Q["pay_r"] = w, r
    d.Q["Mrb"] = d.Q["Mrb"] + rigid_body(m, r, np.zeros((3, 3)))
    return {"w": w, "r": r, "mass": m}


def cg_shift(d: Draw) -> Truth:
    """Move the centre of gravity by 6 to 14 mm forward or aft, and by less across."""
    x, y = d.between(0.006, 0.014) * d.sign(), d.between(0.002, 0.006) * d.sign()
    moved = d.s * np.array([x, y, d.between(-0.006, 0.006)])
    if d.slender:
        moved *= [1.0, 0.5, 0.3]
    d.Q["cg_w"] = d.P["cg"] + moved
    d.Q["Mrb"] = rigid_body(d.P["mass"], d.Q["cg_w"], d.P["I"])
    return {"d_cg": moved, "equal_buoyancy_offset": -moved}


def trapped_water(d: Draw) -> Truth:
    """Add water held by the hull: mass without weight, 15 to 35 % of the vehicle's mass."""
    L, _, H = d.vehicle.box
    m = d.sized(0.15, 0.35) * d.P["mass"]
    r = np.array([d.between(-0.2, 0.2) * L, 0.0, d.between(-0.1, 0.1) * H])
    d.Q["Mrb"] = d.Q["Mrb"] + rigid_body(m, r, np.eye(3) * m * 0.01 * L * L)
    return {"mass": m, "r": r}


def net_buoyancy(d: Draw) -> Truth:
    """Change the buoyancy by 0.8 to 2 % of the weight, less on a torpedo."""
    more = d.sized(0.008, 0.02) * d.weight * d.sign() * (0.4 if d.slender else 1)
    d.Q["buoy"] = d.P["buoy"] + more
    return {"dB": more}


def thr_one(d: Draw) -> Truth:
    """Reduce the thrust of one thruster by 30 to 55 %."""
    i = d.rng.choice(d.vehicle.thrusters)
    d.Q["thr_gain"][i] = 1 - min(0.95, d.sized(0.3, 0.55))
    return {"g": d.Q["thr_gain"] - 1}


def thr_two(d: Draw) -> Truth:
    """Reduce the thrust of two thrusters by 20 to 45 %."""
    i, j = d.rng.choice(d.vehicle.thrusters, 2, replace=False)
    d.Q["thr_gain"][i] = 1 - min(0.9, d.sized(0.2, 0.45))
    d.Q["thr_gain"][j] = 1 - min(0.9, d.sized(0.2, 0.45))
    return {"g": d.Q["thr_gain"] - 1}


def thr_dead(d: Draw) -> Truth:
    """Disable one thruster."""
    i = d.rng.choice(d.vehicle.thrusters)
    d.Q["thr_gain"][i] = 0.0
    return {"g": d.Q["thr_gain"] - 1}


def lag(d: Draw) -> Truth:
    """Increase the time constant of all thrusters by 0.15 to 0.35 s."""
    more = d.sized(0.15, 0.35)
    d.Q["thr_tau"] = d.P["thr_tau"] + more
    return {"dT": more}


def delay(d: Draw) -> Truth:
    """Delay all commands by 0.12 to 0.3 s."""
    late = min(0.6, round(d.sized(0.12, 0.3), 2))
    d.Q["thr_delay"] = late
    return {"d": late}


def deadband(d: Draw) -> Truth:
    """Widen the dead bands by 0.06 to 0.12."""
    more = d.sized(0.06, 0.12)
    d.Q["thr_db"] = d.P["thr_db"] + more
    return {"d": more}


def curve(d: Draw) -> Truth:
    """Change the power of the thrust curve by 0.3 to 0.6."""
    other = d.sized(0.3, 0.6) * (1 if d.P["thr_pow"][0] == 1 else d.sign())
    other = float(np.clip(other, 0.6 - d.P["thr_pow"][0], 1.5))
    d.Q["thr_pow"] = d.P["thr_pow"] + other
    return {"da": other}


def asymmetry(d: Draw) -> Truth:
    """Reduce the reverse thrust by 25 to 45 %."""
    a = min(0.8, d.sized(0.25, 0.45))
    d.Q["thr_rev"] = 1 - a
    return {"a": a}


def added_mass(d: Draw) -> Truth:
    """Increase the added mass of one axis by 30 to 60 % of the axis' total inertia."""
    i = d.axis(0, 1, 5)
    more = d.sized(0.3, 0.6) * (d.P["Ma"][i, i] + d.P["Mrb"][i, i])
    d.Q["Ma"] = d.P["Ma"].copy()
    d.Q["Ma"][i, i] += more
    return {"axis": i, "dM": more}


def linear(d: Draw) -> Truth:
    """Add linear drag on one axis, between half and all of the hull's drag."""
    i = d.axis(0, 1, 2, 5)
    met, speeds = d.resistance()
    d.Q["lin"][i] = D = d.sized(0.5, 1.0) * met[i] / speeds[i]
    return {"axis": i, "D": D}


def quadratic(d: Draw) -> Truth:
    """Add quadratic drag on one axis, between half and all of the hull's drag."""
    i = d.axis(0)
    met, speeds = d.resistance()
    d.Q["quad"][i] = D = d.sized(0.5, 1.0) * met[i] / speeds[i] ** 2
    return {"axis": i, "D": D}


def appendage(d: Draw) -> Truth:
    """Add a drag at the end of an arm, 20 to 40 % of the hull's in surge."""
    L, Wd, H = d.vehicle.box
    met, speeds = d.resistance()
    area = d.sized(0.2, 0.4) * met[0] / (0.5 * d.P["rho"] * speeds[0] ** 2)
    x, y = d.between(0.1, 0.35) * d.sign() * L, d.between(0.35, 0.6) * d.sign() * Wd
    r = np.array([x, y, d.between(0.3, 0.6) * d.sign() * H])
    d.Q["app_cda"], d.Q["app_r"] = area, r
    return {"drag": 0.5 * d.P["rho"] * area, "position": r}


def fin_trim(d: Draw) -> Truth:
    """Rotate a pair of fins by 0.05 to 0.12 rad."""
    angle = d.sized(0.05, 0.12) * d.sign()
    k = int(d.rng.choice([0, 1]))
    d.Q["fin_trim"] = np.zeros(4)
    d.Q["fin_trim"][2 * k : 2 * k + 2] = angle
    return {
        "surface": ["elevator", "rudder"][k],
        "deflection": angle,
        "deflection_in_file_sign": angle if k == 0 else -angle,
        "area_in_file_units": 2 * d.P["fin_area"][0] * d.P["cla"] / np.pi,
        "x": d.P["fin_pos"][0, 0],
    }


def fin_lost(d: Draw) -> Truth:
    """Remove a fin, or a pair if the effect of one is too small."""
    lost = [int(d.rng.integers(4))] if d.s <= 1 else ([0, 1] if d.rng.integers(2) else [2, 3])
    d.Q["fin_area"] = d.P["fin_area"].copy()
    d.Q["fin_area"][lost] = 0
    area = d.P["fin_area"][0] * d.P["cla"] / np.pi
    return {"lost": lost, "pos": d.P["fin_pos"][lost], "area_in_file_units": area}


def tether(d: Draw) -> Truth:
    """Add an elastic tether to an anchor above, slack at first."""
    L, _, H = d.vehicle.box
    k = d.sized(0.4, 1.0) * 0.01 * d.weight
    anchor = np.array([d.between(-6, 6), d.between(-6, 6), MIDDLE - d.between(5, 12)])
    r = np.array([-0.35 * L, 0, -0.4 * H])
    d.Q.update(tet_k=k, tet_L=d.between(3, 7), tet_anchor=anchor, tet_r=r)
    return {"k": k, "L": d.Q["tet_L"], "anchor": anchor, "attachment": r}


def memory(d: Draw) -> Truth:
    """Add fluid memory at two rates."""
    a = d.between(0.5, 1.5)
    part = d.sized(0.5, 1.0)
    K = part * np.diag(d.P["Ma"]) * a
    d.Q["mem_a"], d.Q["mem_K"] = np.array([a, 3 * a]), np.stack([K, 0.5 * K])
    return {"rates": d.Q["mem_a"], "K": d.Q["mem_K"]}


def inflow(d: Draw) -> Truth:
    """Increase the inflow loss of thrusters by 0.25 to 0.45 s/m."""
    c = d.sized(0.25, 0.45)
    d.Q["thr_c"] = d.P["thr_c"] + c
    return {"c": c}


def suction(d: Draw) -> Truth:
    """Add a suction towards the surface that decays with depth."""
    d.Q["suc_A"], d.Q["suc_d"] = d.sized(0.02, 0.04) * d.weight, d.between(0.6, 1.5)
    return {"A": d.Q["suc_A"], "decay": d.Q["suc_d"]}


def dvl_scale(d: Draw) -> Truth:
    """Change the scale of the DVL by 5 to 7 %."""
    return {"sensor": "scale", "s": d.sign() * d.between(0.05, 0.07)}


def dvl_yaw(d: Draw) -> Truth:
    """Rotate the DVL by 0.05 to 0.1 rad about the vertical axis."""
    return {"sensor": "yaw", "alpha": d.sign() * d.between(0.05, 0.1)}


def dvl_late(d: Draw) -> Truth:
    """Delay the DVL by 0.2 s."""
    return {"sensor": "late", "d": 0.2}


def heading_bias(d: Draw) -> Truth:
    """Add a heading error of 0.1 to 0.15 rad."""
    return {"sensor": "heading", "bias": d.sign() * d.between(0.1, 0.15)}


def exchanged(d: Draw) -> Truth:
    """Exchange two command columns in the log; columns are counted from 1."""
    i, j = sorted(int(v) + 1 for v in d.rng.choice(d.vehicle.thrusters, 2, replace=False))
    return {"columns": [i, j]}


def reversed_(d: Draw) -> Truth:
    """Reverse the sign of a command column in the log; columns are counted from 1."""
    return {"columns": [int(d.rng.choice(d.vehicle.thrusters)) + 1]}


def unchanged(d: Draw) -> Truth:
    """Change nothing."""
    return {}


CHANGES: dict[str, Callable[[Draw], Truth]] = {
    change.__name__.rstrip("_"): change
    for change in (
        *(current_steady, current_shear, current_time, payload, float_, cg_shift, trapped_water),
        *(net_buoyancy, thr_one, thr_two, thr_dead, lag, delay, deadband, curve, asymmetry),
        *(added_mass, linear, quadratic, appendage, fin_trim, fin_lost, tether, memory, inflow),
        *(suction, dvl_scale, dvl_yaw, dvl_late, heading_bias, exchanged, reversed_, unchanged),
    )
}


def changed(kind: str, vehicle: Vehicle, rng: np.random.Generator, size: float) -> tuple[Parameters, Truth]:
    """Return the parameters of a changed vehicle, and the true values of the change.

    Args:
        kind: One of `CHANGES`.
        vehicle: The unchanged vehicle, which is not altered.
        rng: Random generator, in the same state for every size.
        size: Factor on the size of the change.
    """
    Q = copy.deepcopy(vehicle.P)
    return Q, CHANGES[kind](Draw(vehicle, Q, rng, size))
