"""Simulator of a batch of underwater vehicles, with separate equations for rigid body and fluid.

Kirchhoff's equations are written twice: for the body with its velocity over ground, and for the added mass
with the velocity through the water.  So no theorem about currents is used.  Integration is a fourth-order
Runge-Kutta step of 10 ms, with commands held for a row of 20 ms.  The state of a body is, in this order:
position (3) [m], NED; quaternion (4); velocity over ground (6) [m/s, rad/s], FRD; thrust (n) [N]; deflections
of fins (4) [rad]; and two fluid memory states (2, 6).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.apart.frames import Array, G, cross, euler, kirchhoff, quaternion, rotation, wrench
from benchmarks.apart.hulls import HULLS, fins

STEP = 0.01
"""Integration step [s]."""
ROW = 0.02
"""Time between rows of a recording, during which commands are held [s]."""
LONGEST = 64
"""Number of steps for which past commands are kept: no delay is longer."""


def defaults(n: int) -> dict[str, Any]:
    """Return parameters of a vehicle with n thrusters without optional features.

    Water: `rho` [kg/m^3]; current `vc` (3) [m/s], its `shear` (2) [1/s] from the depth `shear_z0` [m] on and
    its `trend` (2) [m/s^2] from `trend_t0` [s] on, NED.  Loads, body frame: payload `pay_w` [N] at `pay_r`
    [m]; tether `tet_k` [N/m] from `tet_r` to `tet_anchor` (NED) with the slack length `tet_L` [m]; suction
    `suc_A` [N] of the surface, decaying over `suc_d` [m].  Drag in addition to the hull: `lin`, `quad` (6),
    and an appendage `app_cda` [m^2] at `app_r`; memory of the water `mem_K` (2, 6) with rates `mem_a` (2)
    [1/s]. Fins: see `hulls.fins`, `fin_trim` (4) [rad], `fin_cmd` (n, 4), rad per command, `fin_tau` [s].
    Thrusters: remaining share `thr_gain` (n), `thr_delay` [s], factor on reverse thrust `thr_rev`, loss to
    the inflow `thr_c` (n) [s/m], torque per thrust `thr_k` (n) [m], and the share that tunnels lose under way
    `thr_cross` (n).  `hull` is a factor on the hull, `vol` the displaced volume [m^3].
    """
    z = np.zeros
    return {
        "rho": 1025.0,
        "vc": z(3),
        "shear": z(2),
        "shear_z0": 0.0,
        "trend": z(2),
        "trend_t0": 0.0,
        "pay_w": 0.0,
        "pay_r": z(3),
        "lin": z(6),
        "quad": z(6),
        "app_r": z(3),
        "app_cda": 0.0,
        "tet_k": 0.0,
        "tet_L": 1.0,
        "tet_anchor": np.array([0.0, 0.0, -50.0]),
        "tet_r": z(3),
        "mem_K": z((2, 6)),
        "mem_a": np.array([1.0, 3.0]),
        "suc_A": 0.0,
        "suc_d": 1.0,
        "fin_area": z(4),
        "fin_pos": z((4, 3)),
        "fin_trim": z(4),
        "fin_cmd": z((n, 4)),
        "fin_tau": 0.07,
        "cla": 3.0,
        "stall": 0.35,
        "upwash": 1.0,
        "hull": 1.0,
        "thr_gain": np.ones(n),
        "thr_delay": 0.0,
        "thr_rev": 1.0,
        "thr_c": z(n),
        "thr_k": z(n),
        "thr_cross": z(n),
        "vol": 0.0,
    }


class Simulator:
    """A batch of vehicles of one kind of hull.

    Attributes:
        B: Number of vehicles.
        n: Number of thrusters of each.
        P: Parameters of the vehicles, stacked.
        Mrb: Mass matrices of the bodies (B, 6, 6).
        Ma: Added mass (B, 6, 6).
    """

    def __init__(self, kind: str, params: Sequence[Mapping[str, Any]], step: float = STEP) -> None:
        """Stack the parameters of all vehicles.

        Args:
            kind: Of the hull, one of `HULLS`.
            params: One mapping per vehicle, see `defaults` and `vehicles`.
            step: Of the integration [s]; a whole number of them makes a row.
        """
        self.step = step
        self.P = P = {k: np.stack([np.asarray(p[k], float) for p in params]) for k in params[0]}
        self.B, self.n = P["thr_max"].shape
        self.Mrb, self.Ma = P["Mrb"], P["Ma"]
        self.inverse = np.linalg.inv(self.Mrb + self.Ma)
        r, d = P["thr_pos"], P["thr_dir"]
        self.thrust = np.concatenate([d, cross(r, d)], -1)
        self.torque = np.concatenate([0 * d, d], -1)
        self.hull = HULLS[kind]
        self.steps = round(ROW / step)

    def initial(self, pos: Any, att: Any, nu: Any) -> Array:
        """Return states (B, 29 + n) with thrusters and fins at rest, in steady flow.

        Args:
            pos: NED (B, 3) [m].
            att: Roll, pitch, heading (B, 3) [rad].
            nu: Velocity over ground (B, 6) [m/s, rad/s].
        """
        B, n = self.B, self.n
        x = np.zeros((B, 13 + n + 4 + 12))
        x[:, :3], x[:, 3:7], x[:, 7:13] = pos, quaternion(*np.asarray(att).T), nu
        R = rotation(x[:, 3:7])
        vc, _ = self.water(x[:, :3], np.zeros((B, 3)), 0.0)
        relative = x[:, 7:13].copy()
        relative[:, :3] -= np.einsum("bji,bj->bi", R, vc)
        memory = relative[:, None] / self.P["mem_a"][..., None]
        x[:, 17 + n :] = memory.reshape(B, 12)
        return x

    def water(self, pos: Array, posdot: Array, t: float) -> tuple[Array, Array]:
        """Return the current (B, 3) [m/s] at the vehicles, and its rate along their motion [m/s^2], NED."""
        P = self.P
        vc = P["vc"].copy()
        vc[:, :2] += (
            P["shear"] * (pos[:, 2] - P["shear_z0"])[:, None] + P["trend"] * (t - P["trend_t0"])[:, None]
        )
        rate = np.zeros_like(vc)
        rate[:, :2] = P["shear"] * posdot[:, 2:3] + P["trend"]
        return vc, rate

    def target(self, c: Array) -> Array:
        """Return the steady thrust (B, n) [N] of commands in [-1, 1]: dead band, power, weaker in reverse."""
        P = self.P
        c = np.clip(c, -1, 1)
        a = np.where(np.abs(c) <= P["thr_db"], 0.0, np.abs(c))
        f = a ** P["thr_pow"]
        top = np.where(c >= 0, P["thr_max"], P["thr_max_rev"] * P["thr_rev"][:, None])
        return np.sign(c) * f * top

    def rates(self, x: Array, want: Array, dfin: Array, t: float) -> Array:
        """Return the time derivatives of the states (B, 29 + n).

        Args:
            x: States (B, 29 + n).
            want: Demanded thrust (B, n) [N].
            dfin: Demanded deflections of the fins (B, 4) [rad].
            t: Time [s].
        """
        P, n = self.P, self.n
        pos, q, nu = x[:, :3], x[:, 3:7], x[:, 7:13]
        thr, fin, memory = x[:, 13 : 13 + n], x[:, 13 + n : 17 + n], x[:, 17 + n :].reshape(-1, 2, 6)
        R = rotation(q)
        posdot = np.einsum("bij,bj->bi", R, nu[:, :3])
        vcw, ratew = self.water(pos, posdot, t)
        vc, rate = np.einsum("bji,bj->bi", R, vcw), np.einsum("bji,bj->bi", R, ratew)
        nur = nu.copy()
        nur[:, :3] -= vc
        om = nu[:, 3:]
        tau = self.loads(pos, R)
        tau += self.thrusts(thr, nur)
        tau += self.hull(P, nur) * P["hull"][:, None]
        tau += fins(P, nur, fin + P["fin_trim"])
        tau -= P["lin"] * nur + P["quad"] * np.abs(nur) * nur
        if P["app_cda"].any():
            vl = nur[:, :3] + cross(om, P["app_r"])
            f = -0.5 * (P["rho"] * P["app_cda"] * np.sqrt((vl**2).sum(-1)))[:, None] * vl
            tau += wrench(f, P["app_r"])
        if P["tet_k"].any():
            tau += self.tether(pos, R)
        dm = nur[:, None] - P["mem_a"][..., None] * memory
        tau -= (P["mem_K"] * dm).sum(1)
        # nu_r' = nu' - d(R^T v_c)/dt
        dvc = np.zeros_like(nu)
        dvc[:, :3] = -cross(om, vc) + rate
        rhs = tau - kirchhoff(self.Mrb, nu) - kirchhoff(self.Ma, nur) + np.einsum("bij,bj->bi", self.Ma, dvc)
        nudot = np.einsum("bij,bj->bi", self.inverse, rhs)
        w, i, j, k = q.T
        a, b, c = om.T
        qdot = 0.5 * np.stack(
            [
                -i * a - j * b - k * c,
                w * a + j * c - k * b,
                w * b + k * a - i * c,
                w * c + i * b - j * a,
            ],
            -1,
        )
        thrdot = (want - thr) / P["thr_tau"]
        findot = (dfin - fin) / P["fin_tau"][:, None]
        return np.concatenate([posdot, qdot, nudot, thrdot, findot, dm.reshape(-1, 12)], -1)

    def loads(self, pos: Array, R: Array) -> Array:
        """Return the wrench (B, 6) of weight, buoyancy, payload, surface suction and accelerating water."""
        P = self.P
        down = R[:, 2, :]
        weight = P["mass_w"][:, None] * G * down
        buoyancy = -P["buoy"][:, None] * down
        payload = P["pay_w"][:, None] * down
        suction = -(P["suc_A"] * np.exp(-np.maximum(pos[:, 2], 0) / P["suc_d"]))[:, None] * down
        tau = np.concatenate(
            [
                weight + buoyancy + payload + suction,
                cross(P["cg_w"], weight) + cross(P["cb"], buoyancy + suction) + cross(P["pay_r"], payload),
            ],
            -1,
        )
        trend = np.zeros_like(pos)  # Froude and Krylov: rho V dv/dt at the centre of buoyancy
        trend[:, :2] = P["trend"]
        fk = (P["rho"] * P["vol"])[:, None] * np.einsum("bji,bj->bi", R, trend)
        tau += wrench(fk, P["cb"])
        return tau

    def thrusts(self, thr: Array, nur: Array) -> Array:
        """Return the wrench (B, 6) of thrusters: thrust minus inflow loss, and torque."""
        P = self.P
        at = P["thr_pos"]
        flow = nur[:, None, :3] + cross(np.broadcast_to(nur[:, None, 3:], at.shape), at)
        ua = (P["thr_dir"] * flow).sum(-1)
        T = thr * P["thr_gain"]
        T = T - P["thr_c"] * np.sqrt(np.abs(T) * np.maximum(P["thr_max"], 1e-9)) * ua
        T = T * (1 - P["thr_cross"] * np.tanh(nur[:, :1] ** 2))
        push = np.einsum("bn,bnk->bk", T, self.thrust)
        return push + np.einsum("bn,bnk->bk", T * P["thr_k"], self.torque)

    def tether(self, pos: Array, R: Array) -> Array:
        """Return the wrench (B, 6) of an elastic tether to an anchor, slack below its length."""
        P = self.P
        end = pos + np.einsum("bij,bj->bi", R, P["tet_r"])
        way = P["tet_anchor"] - end
        distance = np.sqrt((way**2).sum(-1)) + 1e-9
        tension = P["tet_k"] * np.maximum(0, distance - P["tet_L"])
        return wrench(np.einsum("bji,bj->bi", R, way / distance[:, None]) * tension[:, None], P["tet_r"])

    def run(
        self,
        x: Array,
        rows: int,
        command: Callable[[int, Array], Array],
        noise: Array | None = None,
        past: Array | None = None,
    ) -> tuple[Array, Array, Array]:
        """Integrate the motion over K = `rows` rows.

        Args:
            x: Initial states (B, 29 + n).
            rows: Number of rows K of the recording.
            command: Function from a row's number and its measurements (B, 12), position, attitude and
                velocity, to the commands (B, n) held until the next row.
            noise: Noise of the measurements (K, B, 12).
            past: Commands before the start (B, n), 0 by default.

        Returns:
            States (K, B, 29 + n), commands (K, B, n) and measurements (K, B, 12).
        """
        P, h = self.P, self.step
        out = np.empty((rows, self.B, x.shape[1]))
        commands = np.empty((rows, self.B, self.n))
        measured = np.empty((rows, self.B, 12))
        history = np.zeros((LONGEST, self.B, self.n))
        if past is not None:
            history[:] = past
        lag = np.round(P["thr_delay"] / h).astype(int)
        each, head = np.arange(self.B), 0
        for k in range(rows):
            out[k] = x
            m = np.concatenate([x[:, :3], euler(x[:, 3:7]), x[:, 7:13]], -1)
            if noise is not None:
                m = m + noise[k]
            measured[k] = m
            commands[k] = c = np.clip(command(k, m), -1, 1)
            for s in range(self.steps):
                head = (head + 1) % LONGEST
                history[head] = c
                late = history[(head - lag) % LONGEST, each]
                want = self.target(late)
                dfin = np.einsum("bn,bnf->bf", np.clip(late, -1, 1), P["fin_cmd"])
                x = self.after(x, want, dfin, k * ROW + s * h)
        return out, commands, measured

    def after(self, x: Array, want: Array, dfin: Array, t: float) -> Array:
        """Return the states after one integration step, with normalised quaternions.

        Args:
            x: States (B, 29 + n).
            want: Demanded thrust (B, n) [N].
            dfin: Demanded deflections of the fins (B, 4) [rad].
            t: Time [s].
        """
        h = self.step
        k1 = self.rates(x, want, dfin, t)
        k2 = self.rates(x + h / 2 * k1, want, dfin, t + h / 2)
        k3 = self.rates(x + h / 2 * k2, want, dfin, t + h / 2)
        k4 = self.rates(x + h * k3, want, dfin, t + h)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        x[:, 3:7] /= np.sqrt((x[:, 3:7] ** 2).sum(-1, keepdims=True))
        return x
