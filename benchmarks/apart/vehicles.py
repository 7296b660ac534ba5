"""Vehicles drawn by chance: an open frame, a torpedo with fixed or driven fins, and a flat body that hovers.

Each maker takes a generator and gives the simulator's parameters and other known data of the vehicle.  Added
mass of ellipsoids after Lamb (1932), articles 114 and 115, tilted so that no axis is one of the file's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import quad

from benchmarks.apart.frames import Array, G, rigid_body, skew
from benchmarks.apart.simulator import defaults

Parameters = dict[str, Any]


@dataclass(frozen=True)
class Vehicle:
    """An unchanged vehicle.

    Attributes:
        P: The simulator's parameters, and `mass` [kg], `cg` [m] and `I` [kg m^2], which a file states.
        kind: Kind of hull.
        box: Length, width and height [m].
        n: Number of commands, of thrusters and of fins.
        own: Effects of the vehicle's file, which a fit estimates.
        fin_commands: Indices of the commands that turn fins, from 0.
        fin: Only for a torpedo: area of a fin in the file [m^2], its place x [m], angle of stall [rad].
        turn: Deflection of a fin at full command [rad].
    """

    P: Parameters
    kind: str
    box: tuple[float, float, float]
    n: int
    own: tuple[str, ...]
    fin_commands: tuple[int, ...] = ()
    fin: dict[str, float] = field(default_factory=dict)
    turn: float = 0.0

    @property
    def driven(self) -> bool:
        """Return whether the vehicle has movable fins."""
        return bool(self.fin_commands)

    @property
    def thrusters(self) -> list[int]:
        """Return the indices of commands that drive a thruster, from 0."""
        return [i for i in range(self.n) if i not in self.fin_commands]


def ellipsoid(a: float, b: float, c: float, rho: float) -> Array:
    """Return the added mass (6,) [kg, kg m^2] of an ellipsoid: half axes a, b, c [m], water rho [kg/m^3]."""

    def alpha(square: float) -> float:
        def integrand(l: float) -> float:
            return a * b * c / ((square + l) * np.sqrt((a * a + l) * (b * b + l) * (c * c + l)))

        return quad(integrand, 0, np.inf, limit=200)[0]

    A0, B0, C0 = alpha(a * a), alpha(b * b), alpha(c * c)
    m = rho * (4 / 3 * np.pi * a * b * c)

    def turning(p: float, q: float, P: float, Q: float) -> float:
        d = p * p - q * q
        if abs(d) < 1e-9:
            return 0.0
        return m / 5 * d * d * (Q - P) / (2 * d + (p * p + q * q) * (P - Q))

    moving = [m * A0 / (2 - A0), m * B0 / (2 - B0), m * C0 / (2 - C0)]
    turned = [turning(b, c, B0, C0), turning(c, a, C0, A0), turning(a, b, A0, B0)]
    return np.array(moving + [abs(each) for each in turned])


def tilted(diagonal: Array, angles: Array, shift: Array | Sequence[float]) -> Array:
    """Return an added-mass matrix (6, 6) that is diagonal in other axes about another point.

    Args:
        diagonal: Diagonal in these axes (6,) [kg, kg m^2].
        angles: Rotation of the axes (3,) [rad].
        shift: Point (3,) [m].
    """
    cx, cy, cz = np.cos(angles)
    sx, sy, sz = np.sin(angles)
    R = (
        np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    )
    D = np.zeros((6, 6))
    D[:3, :3] = R
    D[3:, 3:] = R
    H = np.eye(6)
    H[:3, 3:] = -skew(np.asarray(shift, float))
    return H.T @ D @ np.diag(diagonal) @ D.T @ H


def _body(P: Parameters, mass: float, cg: Any, inertia: Array, buoyancy: float, cb: Any, rho: float) -> None:
    """Set mass [kg], centres [m], inertia [kg m^2], buoyancy [N] and density [kg/m^3]."""
    P.update(
        mass=mass,
        cg=np.array(cg),
        I=inertia,
        Mrb=rigid_body(mass, cg, inertia),
        buoy=buoyancy,
        cb=np.array(cb),
        mass_w=mass,
        cg_w=np.array(cg),
        rho=rho,
        vol=buoyancy / (rho * G),
    )


def _radii(L: float, Wd: float, H: float) -> Array:
    """Return the squared radii of gyration (3,) [m^2] of a homogeneous box."""
    return np.array([Wd**2 + H**2, L**2 + H**2, L**2 + Wd**2]) / 12


def rov(rng: np.random.Generator) -> Vehicle:
    """Draw an open frame with eight thrusters: four vectored in a plane, four vertical."""
    n = 8
    rho = rng.choice([1000.0, 1025.0])
    P = defaults(n)
    L, Wd, H = rng.uniform(0.45, 0.95), rng.uniform(0.4, 0.7), rng.uniform(0.3, 0.5)
    fill = rng.uniform(0.13, 0.2) * rng.uniform(0.9, 1.1)
    mass = max(rho * L * Wd * H * fill * 1.0, 12.0)
    k2 = _radii(L, Wd, H) * rng.uniform(1.1, 1.4) * rng.uniform(0.96, 1.04, 3)
    inertia = np.diag(mass * k2)
    inertia[0, 2] = inertia[2, 0] = -mass * 0.003 * L * H * np.clip(rng.normal(), -2, 2)
    bg = rng.uniform(0.03, 0.06)
    cg = [rng.normal(0, 0.005), rng.normal(0, 0.003), bg * 0.6]
    cb = [cg[0] + rng.normal(0, 0.002), cg[1] + rng.normal(0, 0.001), -bg * 0.4]
    _body(P, mass, cg, inertia, mass * G + rng.uniform(0.5, 4.0), cb, rho)
    ma = mass * np.array([rng.uniform(0.45, 0.8), rng.uniform(0.7, 1.2), rng.uniform(1.0, 1.7)])
    mr = mass * k2 * rng.uniform(0.5, 1.0, 3)
    P["Ma"] = tilted(np.concatenate([ma, mr]), rng.normal(0, 0.04, 3), rng.normal(0, 0.03, 3))
    angle = rng.uniform(35, 50) * np.pi / 180
    px, py, pz = L * 0.36, Wd * 0.32, rng.uniform(0.0, 0.05)
    ca, sa = np.cos(angle), np.sin(angle)
    pos = [[px, py, pz], [px, -py, pz], [-px, py, pz], [-px, -py, pz]]
    dirs = [[ca, -sa, 0], [ca, sa, 0], [ca, sa, 0], [ca, -sa, 0]]
    vx, vy = L * 0.28, Wd * 0.38
    pos += [[vx, vy, -0.02], [vx, -vy, -0.02], [-vx, vy, -0.02], [-vx, -vy, -0.02]]
    dirs += [[0, 0, -1.0]] * 4
    top = rng.uniform(28, 45) * (mass / 14) ** 0.5
    P.update(
        thr_pos=np.array(pos),
        thr_dir=np.array(dirs, float),
        thr_max=np.full(n, top),
        thr_max_rev=np.full(n, top * rng.uniform(0.75, 0.95)),
        thr_db=np.full(n, rng.uniform(0.03, 0.08)),
        thr_pow=np.full(n, rng.choice([1.0, 2.0])),
        thr_tau=np.full(n, rng.uniform(0.06, 0.15)),
        thr_c=np.full(n, rng.uniform(0.03, 0.08)),
        thr_k=np.zeros(n),
    )
    bars = 14
    at = rng.uniform(-0.5, 0.5, (bars, 3)) * [L, Wd, H]
    parts = rng.dirichlet(np.ones(bars) * 2.0, 3).T
    areas = np.array([Wd * H, L * H, L * Wd])
    areas = areas * np.array([rng.uniform(0.9, 1.4), rng.uniform(0.6, 0.9), rng.uniform(1.1, 1.6)])
    P.update(
        el_pos=at,
        el_cda=parts * areas * 0.8,
        shade=rng.uniform(0.25, 0.45),
        re_a=rng.uniform(0.03, 0.10),
        plate_pos=np.array([[0.0, Wd / 2, 0.03], [0.0, -Wd / 2, 0.03]]),
        plate_area=0.25 * L * H,
        plate_chord=L,
    )
    return Vehicle(P, "rov", (L, Wd, H), n, ("added_mass", "linear_damping", "quadratic_damping"))


def torpedo(rng: np.random.Generator, driven: bool) -> Vehicle:
    """Draw a slender hull with a propeller and movable fins, or with fixed fins and four tunnel thrusters."""
    rho = 1025.0
    n = 3 if driven else 5
    P = defaults(n)
    L = rng.uniform(1.4, 2.2)
    D = L / rng.uniform(7.5, 10)
    mass = rho * np.pi / 4 * D * D * L * rng.uniform(0.78, 0.86)
    inertia = np.diag([mass * D * D / 8 * 1.15, *([mass * L * L / 12 * rng.uniform(0.85, 1.0)] * 2)])
    bg = rng.uniform(0.012, 0.025) * (2.0 if not driven else 1.0)
    cg = [rng.normal(0, 0.002), rng.normal(0, 0.001), bg]
    _body(P, mass, cg, inertia, mass * G + rng.uniform(0.0, 0.01) * mass * G, [0.0, 0.0, 0.0], rho)
    ma = ellipsoid(L / 2, D / 2, D / 2, rho)
    ma *= mass / (rho * 4 / 3 * np.pi * L / 2 * D * D / 4)
    ma[3] = 0.02 * mass * D * D + 0.03
    M = tilted(ma, np.array([0.0, rng.normal(0, 0.008), rng.normal(0, 0.008)]), [0.0, 0.0, 0.0])
    xf = -0.43 * L
    mf = rho * np.pi * (0.9 * D) ** 2 * 0.09 * L * 0.35
    for i, j, sign in ((1, 5, 1), (2, 4, -1)):  # fins carry water along
        M[i, i] += mf
        M[j, j] += mf * xf * xf
        M[i, j] += sign * mf * xf
        M[j, i] += sign * mf * xf
    P["Ma"] = M
    _slender(P, rng, L, D, mass)
    b = 0.95 * D
    area = rng.uniform(0.55, 0.8) * D * D * 0.55
    P.update(
        fin_area=np.full(4, area),
        fin_pos=np.array([[xf, b, 0], [xf, -b, 0], [xf, 0, -b], [xf, 0, b]]),
        cla=rng.uniform(2.6, 3.4),
        stall=rng.uniform(0.28, 0.4),
        upwash=rng.uniform(1.02, 1.12),
        fin_tau=rng.uniform(0.04, 0.09),
    )
    top = P["kx"] * rng.uniform(1.6, 2.3) ** 1.85 * 1.1
    turn = 0.0
    if driven:
        turn = rng.uniform(0.28, 0.38)
        P["fin_cmd"] = np.zeros((n, 4))
        P["fin_cmd"][1, :2] = turn
        P["fin_cmd"][2, 2:] = turn
        pos, dirs = [[-0.52 * L, 0, 0], [0, 0, 0], [0, 0, 0]], [[1.0, 0, 0], [0, 0, 0], [0, 0, 0]]
        tops = np.array([top, 1e-6, 1e-6])
        P["thr_k"] = np.array([0.03 * D, 0, 0])
    else:
        pos = [[-0.52 * L, 0, 0], [0.33 * L, 0, 0], [0.36 * L, 0, 0], [-0.3 * L, 0, 0], [-0.33 * L, 0, 0]]
        dirs = [[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1]]
        tunnel = rng.uniform(0.25, 0.4) * top + 2.0
        tops = np.array([top, tunnel, tunnel, tunnel, tunnel])
        P["thr_k"] = np.array([0.03 * D, 0, 0, 0, 0])
        P["thr_cross"] = np.array([0, 0.06, 0.06, 0.06, 0.06])
    loss = np.zeros(n)
    loss[0] = rng.uniform(0.03, 0.08)
    power = np.full(n, rng.choice([1.0, 2.0]))
    P.update(
        thr_pos=np.array(pos, float),
        thr_dir=np.array(dirs, float),
        thr_max=tops,
        thr_max_rev=tops * rng.uniform(0.6, 0.9),
        thr_db=np.full(n, rng.uniform(0.02, 0.06)),
        thr_pow=power,
        thr_tau=np.full(n, rng.uniform(0.1, 0.25)),
        thr_c=loss,
    )
    if driven:
        P["thr_db"][1:] = 0.0
    own = ("added_mass", "added_mass_coupling", "quadratic_damping", "crossflow_drag", "body_lift")
    fin = {"area": area * P["cla"] / np.pi, "x": xf, "stall": float(P["stall"])}
    return Vehicle(P, "torpedo", (L, D, D), n, own, (1, 2) if driven else (), fin, turn)


def _slender(P: Parameters, rng: np.random.Generator, L: float, D: float, mass: float) -> None:
    """Set strips, skin friction, lift and damping of a hull of length L and diameter D [m]."""
    rho, strips = P["rho"], 24
    edges = np.linspace(-0.5, 0.5, strips + 1) * L
    x = (edges[1:] + edges[:-1]) / 2
    s = x / L + 0.5  # 0 at the stern, 1 at the nose
    nose = np.sqrt(np.clip(1 - ((s - 0.82) / 0.18) ** 2, 0, 1)) * (s > 0.82) + (s <= 0.82)
    profile = np.minimum(1.0, np.minimum(nose, 0.25 + 0.75 * np.clip(s / 0.3, 0, 1) ** 0.8))
    P.update(
        st_x=x,
        st_d=D * profile,
        st_dx=L / strips,
        cd_hi=rng.uniform(1.0, 1.25),
        cd_lo=rng.uniform(0.4, 0.6),
        re_c=rng.uniform(0.6e5, 1.6e5),
    )
    P["kx"] = 0.5 * rho * np.pi * D * D / 4 * rng.uniform(0.16, 0.26)
    P.update(
        klift=0.5 * rho * np.pi * D * D / 4 * rng.uniform(0.8, 1.4),
        kvort=rng.uniform(0.5, 1.2),
        x_lift=-rng.uniform(0.1, 0.2) * L,
        kp1=0.15 * mass * D * D,
        kp2=rng.uniform(0.3, 0.8) * mass * D * D,
        kq1=0.02 * mass * L * L,
    )


def hover(rng: np.random.Generator) -> Vehicle:
    """Draw a hovering flat body: two aft propellers, two vertical and one or two lateral thrusters."""
    n = int(rng.choice([5, 6]))
    rho = 1025.0
    P = defaults(n)
    L, Wd, H = rng.uniform(1.1, 1.6), rng.uniform(0.5, 0.8), rng.uniform(0.35, 0.55)
    mass = rho * L * Wd * H * rng.uniform(0.42, 0.55)
    k2 = _radii(L, Wd, H) * rng.uniform(0.75, 1.0) * rng.uniform(0.97, 1.03, 3)
    inertia = np.diag(mass * k2)
    inertia[0, 2] = inertia[2, 0] = mass * 0.005 * L * H * rng.normal()
    bg = rng.uniform(0.04, 0.07)
    cg = [rng.normal(0, 0.004), rng.normal(0, 0.002), bg * 0.5]
    cb = [cg[0] + rng.normal(0, 0.001), cg[1], -bg * 0.5]
    _body(P, mass, cg, inertia, mass * G * (1 + rng.uniform(0.001, 0.006)), cb, rho)
    ma = ellipsoid(L / 2, Wd / 2, H / 2, rho) * rng.uniform(0.9, 1.2, 6)
    ma = ma + np.array([0, 0, 0, 0.02, 0.01, 0.01]) * mass
    P["Ma"] = tilted(ma, rng.normal(0, 0.04, 3), rng.normal(0, 0.04, 3))
    sections = 20
    edges = np.linspace(-0.5, 0.5, sections + 1) * L
    x = (edges[1:] + edges[:-1]) / 2
    stern, bow = np.clip(-2 * x / L, 0, 1), np.clip(2 * x / L, 0, 1)
    taper = np.clip(1 - 0.45 * stern**2 - 0.25 * bow**3, 0.1, 1)
    P.update(
        st_x=x,
        st_dx=L / sections,
        st_w=Wd * taper,
        st_h=H * taper,
        cdy=rng.uniform(0.9, 1.4),
        cdz=rng.uniform(1.0, 1.5),
        kx=0.5 * rho * Wd * H * rng.uniform(0.3, 0.5),
        klift=0.5 * rho * L * H * rng.uniform(0.1, 0.3),
        klift_z=0.5 * rho * L * Wd * rng.uniform(0.1, 0.3),
        x_lift=rng.uniform(-0.1, 0.15) * L,
        kp1=0.02 * mass * Wd**2 * 2,
        kp2=0.5 * rho * Wd**5 * 0.15,
        kq1=0.03 * mass * L * L,
        mast_pos=np.array([rng.uniform(-0.2, 0.3) * L, 0.0, -H * 0.65]),
        mast_cda=rng.uniform(0.01, 0.03),
    )
    ty = Wd * 0.42
    pos = [[-0.4 * L, ty, 0.02], [-0.4 * L, -ty, 0.02], [0.32 * L, 0, 0], [-0.3 * L, 0, 0]]
    dirs = [[1.0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 1]]
    lateral = [[0.03 * L, 0, 0.01]] if n == 5 else [[0.3 * L, 0, 0.01], [-0.27 * L, 0, 0.01]]
    pos += lateral
    dirs += [[0, 1, 0]] * len(lateral)
    tx = P["kx"] * rng.uniform(0.9, 1.3) ** 1.85 / 2 + 4
    tv = 0.5 * rho * L * Wd * 1.2 * 0.35**2 / 2 + 3
    ts = 0.5 * rho * L * H * 1.1 * 0.4**2 / (n - 4) + 3
    tops = np.array([tx, tx, tv, tv] + [ts] * (n - 4))
    P.update(
        thr_pos=np.array(pos, float),
        thr_dir=np.array(dirs, float),
        thr_max=tops,
        thr_max_rev=tops * rng.uniform(0.7, 1.0),
        thr_db=np.full(n, rng.uniform(0.02, 0.06)),
        thr_pow=np.full(n, rng.choice([1.0, 2.0])),
        thr_tau=np.full(n, rng.uniform(0.1, 0.25)),
        thr_c=np.full(n, rng.uniform(0.03, 0.08)),
        thr_k=np.zeros(n),
    )
    own = ("added_mass", "linear_damping", "quadratic_damping", "crossflow_drag")
    return Vehicle(P, "hover", (L, Wd, H), n, own)


MAKERS: dict[str, Callable[[np.random.Generator], Vehicle]] = {
    "rov": rov,
    "hover": hover,
    "fixed": lambda rng: torpedo(rng, False),
    "driven": lambda rng: torpedo(rng, True),
}
