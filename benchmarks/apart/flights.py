"""Flight plans: multi-sines or steps on every axis, or way-points with feedback from measurements.

Commands are computed with the unchanged vehicle's allocation, for any change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.apart.frames import Array, G
from benchmarks.apart.hulls import resistance
from benchmarks.apart.simulator import ROW
from benchmarks.apart.vehicles import Vehicle

REACHED = {
    "rov": np.array([0.7, 0.5, 0.4, 0.6, 0.6, 0.8]),
    "hover": np.array([0.8, 0.35, 0.3, 0.4, 0.3, 0.4]),
    "torpedo": np.array([1.3, 0.3, 0.3, 0.6, 0.3, 0.35]),
}
"""Speed on each axis for which the size of forces is chosen [m/s, rad/s]."""
MODES = ("axes", "steps", "way")
UNBOUND = 1e9
"""Bound that never takes effect [N, N m]."""


def multisine(
    rng: np.random.Generator, t: Array, low: float = 0.03, high: float = 0.6, parts: int = 6
) -> Array:
    """Return a sum of sines between two frequencies [Hz], in [-1, 1], over times `t` [s]."""
    f = np.exp(rng.uniform(np.log(low), np.log(high), parts))
    a = rng.uniform(0.4, 1.0, parts) * (f / low) ** -0.25
    phase = rng.uniform(0, 2 * np.pi, parts)
    s = (a[:, None] * np.sin(2 * np.pi * f[:, None] * t + phase[:, None])).sum(0)
    return s / np.abs(s).max()


def steps(rng: np.random.Generator, t: Array, low: float = 1.5, high: float = 6.0) -> Array:
    """Return levels in [-1, 1], each held for `low` to `high` seconds, over times `t` [s]."""
    out, at = np.zeros_like(t), 0.0
    while at < t[-1]:
        small = [rng.uniform(-1, 1), rng.uniform(-1, 1)]
        level = rng.choice([0.0, *small, np.sign(rng.normal()) * rng.uniform(0.7, 1)])
        out[t >= at] = level
        at += rng.uniform(low, high)
    return out


@dataclass(frozen=True)
class Leg:
    """One session to fly.

    Attributes:
        vehicle: The unchanged vehicle, for which commands are computed.
        mode: One of `MODES`.
        rng: Random generator of signals and way-points.
        start: Position (3) [m], NED, and heading [rad].
        excursion: Greatest change of depth between way-points [m].
    """

    vehicle: Vehicle
    mode: str
    rng: np.random.Generator
    start: tuple[float, float, float, float]
    excursion: float


class Pilot:
    """Pilot of a batch of legs with equal numbers of commands.

    It is called with the number of a row and the measurements there, and returns the commands.
    """

    def __init__(self, legs: Sequence[Leg], rows: int) -> None:
        """Draw signals and way-points for all rows."""
        B, n = len(legs), legs[0].vehicle.n
        t = np.arange(rows) * ROW
        self.n = n
        self.force, self.extra = np.zeros((rows, B, 6)), np.zeros((rows, B, n))
        self.direct, self.points = np.zeros((rows, B, n)), np.zeros((rows, B, 4))
        self.kp, self.kd, self.loop = np.zeros((B, 6)), np.zeros((B, 6)), np.zeros(B)
        self.allocation, self.driven = np.zeros((B, n, 6)), np.zeros(B, bool)
        self.top, self.reverse, self.power = np.zeros((B, n)), np.zeros((B, n)), np.zeros((B, n))
        for b, leg in enumerate(legs):
            P = leg.vehicle.P
            self.top[b], self.reverse[b], self.power[b] = P["thr_max"], P["thr_max_rev"], P["thr_pow"]
            if leg.vehicle.driven:
                self._steer(b, leg, t)
            else:
                self._push(b, leg, t)
            self.points[:, b] = way_points(leg, t)

    def _steer(self, b: int, leg: Leg, t: Array) -> None:
        """Set the commands of leg `b`, a torpedo: propeller at changing speed, elevator and rudder."""
        rng, mode = leg.rng, leg.mode
        self.driven[b] = True
        direct = self.direct[:, b]
        base = rng.uniform(0.55, 0.85)
        speed = base + 0.3 * (steps(rng, t, 5, 15) if mode != "axes" else multisine(rng, t, 0.02, 0.2))
        direct[:, 0] = np.clip(speed, 0.1, 1.0)
        amplitude = {"axes": 0.55, "steps": 0.5, "way": 0.15}[mode]
        signal = steps if mode == "steps" else multisine
        direct[:, 1] = 0.5 * amplitude * signal(rng, t)
        direct[:, 2] = amplitude * signal(rng, t)
        self.loop[b] = {"axes": 0.25, "steps": 0.25, "way": 1.0}[mode]

    def _push(self, b: int, leg: Leg, t: Array) -> None:
        """Set the commands of leg `b`: forces and moments, and a small independent part of each thruster."""
        P, kind, n, rng, mode = leg.vehicle.P, leg.vehicle.kind, self.n, leg.rng, leg.mode
        r, d, tops = P["thr_pos"], P["thr_dir"], P["thr_max"]
        each = np.concatenate([d, np.cross(r, d)], 1).T
        able = np.abs(each) @ tops
        righting = abs(P["cg"][2] - P["cb"][2]) * P["mass"] * G
        limit = np.minimum(able, [*[UNBOUND] * 3, 0.45 * righting, 0.45 * righting, UNBOUND])
        met = resistance(P, kind, REACHED[kind])
        needed = np.where(np.arange(6) % 5 == 3, UNBOUND, 1.5 * met + 0.1)
        limit = np.minimum(limit * [0.7, 0.7, 0.7, 1, 1, 0.6], needed)
        limit[3:5] = np.minimum(able[3:5], 0.28 * righting)
        self.allocation[b] = np.linalg.pinv(each * 1.0, rcond=1e-3)
        signal = steps if mode == "steps" else multisine
        amplitude = 0.2 if mode == "way" else rng.uniform(0.75, 1.0)
        for i in range(6):
            if able[i] > 1e-6:
                self.force[:, b, i] = amplitude * limit[i] * signal(rng, t)
        if kind == "torpedo":
            ahead = 0.6 + 0.7 * (signal(rng, t)) if mode != "way" else 0.3
            self.force[:, b, 0] = limit[0] * ahead
        for j in range(n):
            vertical = abs(d[j, 2]) > 0.5
            if n > 6 or not vertical:
                size = 0.06 if vertical else 0.15
                self.extra[:, b, j] = size * tops[j] * multisine(rng, t, 0.05, 0.8)
        if mode == "way":
            self.loop[b] = 1.0
            self.kp[b] = np.array([0.5, 0.5, 0.5, 0, 0, 0.5]) * able * np.array([1, 1, 1, 0, 0, 1])
            self.kd[b] = np.array([0.8, 0.8, 0.8, 0, 0, 0.7]) * able

    def __call__(self, k: int, m: Array) -> Array:
        """Return the commands (B, n) of row k from its measurements (B, 12)."""
        psi = m[:, 5]
        e = self.points[k] - np.stack([m[:, 0], m[:, 1], m[:, 2], psi], 1)
        e[:, 3] = np.arctan2(np.sin(e[:, 3]), np.cos(e[:, 3]))
        c, s = np.cos(psi), np.sin(psi)
        ex, ey = c * e[:, 0] + s * e[:, 1], -s * e[:, 0] + c * e[:, 1]
        near = [np.clip(each, -1, 1) for each in (ex, ey, e[:, 2])]
        error = np.stack([*near, 0 * ex, 0 * ex, np.clip(e[:, 3], -0.8, 0.8)], 1)
        want = self.force[k] + self.kp * error - self.kd * m[:, 6:12]
        f = np.einsum("bnk,bk->bn", self.allocation, want) + self.extra[k]
        top = np.where(f >= 0, self.top, self.reverse)
        commands = np.sign(f) * (np.abs(f) / np.maximum(top, 1e-9)) ** (1 / self.power)
        commands = np.clip(commands, -1, 1)
        if self.driven.any():
            tilt = -np.clip(0.12 * e[:, 2], -0.35, 0.35)
            elevator = -1.8 * (tilt - m[:, 4]) + 1.2 * m[:, 10]
            rudder = 1.0 * e[:, 3] - 0.8 * m[:, 11]
            held = np.where(self.loop < 1, 0, np.clip(rudder, -1, 1))
            closed = np.stack([0 * elevator, np.clip(elevator, -1, 1), held], 1)
            steered = self.direct[k] + self.loop[:, None] * closed
            commands = np.where(self.driven[:, None], steered, commands)
        return np.clip(commands, -1, 1)


def way_points(leg: Leg, t: Array) -> Array:
    """Return the position [m], NED, and heading [rad] to hold in each row, (rows, 4).

    They change every 9 to 16 s.

    Args:
        leg: The session.
        t: Times of the rows (rows,) [s].
    """
    rng, start, excursion = leg.rng, leg.start, leg.excursion
    points, at = np.zeros((t.size, 4)), 0.0
    here = np.array(start, float)
    while at < t[-1]:
        points[t >= at] = here
        at += rng.uniform(9, 16)
        here = np.array(
            [
                start[0] + rng.uniform(-5, 5),
                start[1] + rng.uniform(-5, 5),
                start[2] + rng.uniform(-excursion, excursion),
                here[3] + rng.uniform(-2, 2),
            ]
        )
        if start[2] < 5:  # not through the surface
            here[2] = np.clip(here[2], 0.4, 6)
    return points
