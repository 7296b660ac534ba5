"""Hydrodynamic wrenches on hulls and fins as functions of the velocity through the water.

Every hull takes the parameters `P` of a batch of B bodies and nu_r (B, 6) [m/s, rad/s], body frame.  It
returns the wrench (B, 6) [N, N m] on the body about the origin.  None is a formula of hydro's catalogue; all
dissipate energy.  Sources: normal force and pressure centre of a plate, Rayleigh (1876); cross-flow strips
and the drag of bars, Hoerner (1965), chapters 3 and 13; fins with stall, after Hoerner (1985), chapter 17.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from benchmarks.apart.frames import Array, cross, wrench

VISCOSITY = 1.2e-6
"""Kinematic viscosity of sea water [m^2/s]."""
Parameters = Mapping[str, Array]


def frame(P: Parameters, nu: Array) -> Array:
    """Compute the wrench of an open frame: bars and boxes with mutual shielding, and side plates.

    Reads `el_pos` (B, E, 3) [m] and `el_cda` (B, E, 3) [m^2] of the bars; `shade`, the part of its force
    that a bar right behind the middle loses; `re_a` [(m/s)^0.5], by which Cd falls with the speed;
    `plate_pos`, `plate_area` [m^2], `plate_chord` [m] and `rho` [kg/m^3].
    """
    v, om = nu[:, :3], nu[:, 3:]
    r = P["el_pos"]
    vp = v[:, None] + cross(np.broadcast_to(om[:, None], r.shape), r)
    speed = np.sqrt((vp**2).sum(-1, keepdims=True) + 1e-12)
    whole = v / np.sqrt((v**2).sum(-1, keepdims=True) + 1e-4)
    unit = r / (np.sqrt((r**2).sum(-1, keepdims=True)) + 1e-6)
    behind = np.maximum(0.0, -(unit * whole[:, None]).sum(-1, keepdims=True))
    shade = 1 - P["shade"][:, None, None] * behind**2
    size = speed + P["re_a"][:, None, None] * np.sqrt(speed)
    f = -0.5 * P["rho"][:, None, None] * P["el_cda"] * shade * size * vp
    w = np.concatenate([f.sum(1), cross(r, f).sum(1)], -1)
    for side in (0, 1):  # normal y; the pressure centre lies upstream of the middle
        rp = P["plate_pos"][:, side]
        vl = v + cross(om, rp)
        V = np.sqrt((vl**2).sum(-1) + 1e-12)
        sine = np.abs(vl[:, 1]) / V
        cn = 2 * np.pi / (4 + np.pi * sine)
        fn = -0.5 * P["rho"] * P["plate_area"] * cn * V * vl[:, 1]
        centre = 0.75 * P["plate_chord"] / (4 + np.pi * sine) * vl[:, 0] / V
        at = rp + np.stack([centre, 0 * centre, 0 * centre], -1)
        w = w + wrench(np.stack([0 * fn, fn, 0 * fn], -1), at)
    return w


def torpedo(P: Parameters, nu: Array) -> Array:
    """Compute the wrench of a slender hull: cross-flow strips with Cd(Re), turbulent skin friction, lift.

    Reads the strips `st_x`, `st_d` (B, E) and `st_dx` (B) [m]; their `cd_lo`, `cd_hi` and `re_c`, the
    Reynolds number between; `kx` [N (s/m)^1.85]; `klift` [kg/m] at `x_lift` [m] and `kvort`, its growth
    with the angle; `kp1`, `kp2`, `kq1`, damping of turning [N m s, N m s^2].
    """
    u, v, w, p, q, r = nu.T
    x, d, dx = P["st_x"], P["st_d"], P["st_dx"][:, None]
    vs, ws = v[:, None] + x * r[:, None], w[:, None] - x * q[:, None]
    uc = np.sqrt(vs**2 + ws**2 + 1e-12)
    re = uc * d / VISCOSITY
    high, low = P["cd_hi"], P["cd_lo"]
    cd = high[:, None] - (high - low)[:, None] / (1 + (P["re_c"][:, None] / (re + 1.0)) ** 2)
    k = -0.5 * P["rho"][:, None] * d * dx * cd * uc
    fy, fz = k * vs, k * ws
    V2 = u * u + v * v + w * w + 1e-12
    sin2 = (v * v + w * w) / V2
    X = -P["kx"] * (u * u + 1e-8) ** 0.425 * u * (1 + 2.5 * sin2)
    Y, Z = fy.sum(1), fz.sum(1)
    N, M = (x * fy).sum(1), -(x * fz).sum(1)
    # there is less potential flow at the afterbody: it lifts, and with vortices the more
    kl = P["klift"] * (1 + P["kvort"] * np.sqrt(sin2))
    va, wa = v + P["x_lift"] * r, w - P["x_lift"] * q
    ly, lz = -kl * np.abs(u) * va, -kl * np.abs(u) * wa
    Y, Z = Y + ly, Z + lz
    N, M = N + P["x_lift"] * ly, M - P["x_lift"] * lz
    K = -P["kp1"] * p - P["kp2"] * np.abs(p) * p
    M = M - P["kq1"] * q
    N = N - P["kq1"] * r
    return np.stack([X, Y, Z, K, M, N], -1)


def flat(P: Parameters, nu: Array) -> Array:
    """Compute the wrench of a flat body: rectangular sections with angle-dependent drag and lift, and a mast.

    Reads the sections `st_x`, `st_w`, `st_h` (B, E) and `st_dx` (B) [m], their `cdy` and `cdz`; `kx`
    [N (s/m)^1.85]; `klift`, `klift_z` [kg/m] at `x_lift` [m]; `kp1`, `kp2`, `kq1` as of a torpedo; the mast's
    `mast_pos` (B, 3) [m] and `mast_cda` [m^2].
    """
    u, v, w, p, q, r = nu.T
    x, dx = P["st_x"], P["st_dx"][:, None]
    W, H = P["st_w"], P["st_h"]
    vs, ws = v[:, None] + x * r[:, None], w[:, None] - x * q[:, None]
    U2 = vs**2 + ws**2 + 1e-10
    U = np.sqrt(U2)
    c, s = vs / U, ws / U
    cdy, cdz = P["cdy"][:, None], P["cdz"][:, None]
    along = cdy * c * c + cdz * s * s + 0.5 * (2 * s * c) ** 2
    across = 0.35 * (2 * s * c)  # at right angles to the flow: it takes no energy and gives none
    area = np.sqrt((H * c) ** 2 + (W * s) ** 2)
    re = 1 + 0.25 * np.exp(-U / 0.12)
    k = 0.5 * P["rho"][:, None] * area * dx * U2 * re
    fy, fz = -k * (along * c - across * s), -k * (along * s + across * c)
    V2 = u * u + v * v + w * w + 1e-12
    X = -P["kx"] * (u * u + 1e-8) ** 0.425 * u * (1 + 0.8 * (v * v + w * w) / V2)
    Y, Z = fy.sum(1), fz.sum(1)
    N, M = (x * fy).sum(1), -(x * fz).sum(1)
    ly, lz = -P["klift"] * np.abs(u) * v, -P["klift_z"] * np.abs(u) * w
    Y, Z = Y + ly, Z + lz
    N, M = N + P["x_lift"] * ly, M - P["x_lift"] * lz
    K = -P["kp1"] * p - P["kp2"] * np.abs(p) * p * (1 + 0.5 * np.sqrt(V2))
    out = np.stack([X, Y, Z, K, M - P["kq1"] * q, N - P["kq1"] * r], -1)
    rm = P["mast_pos"]
    vl = nu[:, :3] + cross(nu[:, 3:], rm)
    speed = np.sqrt(vl[:, 0] ** 2 + vl[:, 1] ** 2 + 1e-12)
    f = -0.5 * (P["rho"] * P["mast_cda"] * speed)[:, None] * vl * np.array([1.0, 1.0, 0.1])
    return out + wrench(f, rm)


HULLS: dict[str, Callable[[Parameters, Array], Array]] = {"rov": frame, "torpedo": torpedo, "hover": flat}


def resistance(P: Mapping[str, object], kind: str, speeds: Array) -> Array:
    """Return the resistance of one vehicle's hull to motion along each axis alone, (6,) [N, N m].

    Args:
        P: Parameters of one vehicle, without the leading B.
        kind: Kind of its hull.
        speeds: Speed on each axis (6,) [m/s, rad/s].
    """
    one = {k: np.asarray(v, float)[None] for k, v in P.items()}
    return np.array([-HULLS[kind](one, (np.eye(6)[i] * speeds[i])[None])[0, i] for i in range(6)])


def fins(P: Parameters, nu: Array, delta: Array) -> Array:
    """Return the wrench (B, 6) [N, N m] of four stern fins: starboard and port, upper and lower.

    Reads `fin_area` (B, 4) [m^2], `fin_pos` (B, 4, 3) [m], `cla` [1/rad], the angle of `stall` [rad] and
    `upwash` of the hull.

    Args:
        P: Parameters of the batch.
        nu: Velocity through the water (B, 6) [m/s, rad/s].
        delta: Deflections (B, 4) [rad].
    """
    if P["fin_area"].max() <= 0:
        return np.zeros_like(nu)
    v, om = nu[:, :3], nu[:, 3:]
    out = np.zeros_like(nu)
    V = np.sqrt((v**2).sum(-1) + 1e-9)
    sinb = np.sqrt(v[:, 1] ** 2 + v[:, 2] ** 2) / V
    shade = 1 - 0.25 * sinb**2
    for i in range(4):
        r = P["fin_pos"][:, i]
        vl = v + cross(om, r)
        vertical = i >= 2
        vn = (vl[:, 1] if vertical else vl[:, 2]) * P["upwash"]
        va = vl[:, 0]
        ve2 = va**2 + vn**2 + 1e-9
        # in (-pi, pi): astern the fin meets the flow by its trailing edge
        angle = np.arctan2(vn, np.abs(va) + 1e-6) + delta[:, i] * np.sign(va)
        stalled = 0.5 * (1 + np.tanh((np.abs(angle) - P["stall"]) / 0.06))
        attached = (1 - stalled) * P["cla"] * angle * (1 - 0.3 * np.abs(angle))
        cl = attached + stalled * 0.9 * np.sin(2 * angle)
        cd = 0.012 + (1 - stalled) * cl**2 / (np.pi * 2.2) + stalled * 1.3 * np.sin(angle) ** 2
        qd = 0.5 * P["rho"] * P["fin_area"][:, i] * ve2 * shade
        ca, sa = va / np.sqrt(ve2), vn / np.sqrt(ve2)
        fn = -qd * (cl * np.abs(ca) + cd * sa)
        fa = -qd * (cd * ca - cl * sa * np.sign(va))
        f = np.stack([fa, fn if vertical else 0 * fn, 0 * fn if vertical else fn], -1)
        out = out + wrench(f, r)
    return out
