"""Recordings of cases: sessions flown in batches, sensors and logs, and the effect of a change.

Sessions of hulls of one kind with the same number of commands are flown together.  Their noise is drawn for
the whole batch at once, and the motion of a session does not depend on others.  So some sessions of a batch
can be flown alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from benchmarks.apart.cases import Drawn
from benchmarks.apart.changes import MIDDLE
from benchmarks.apart.flights import Leg, Pilot
from benchmarks.apart.frames import Array
from benchmarks.apart.simulator import ROW, Simulator
from benchmarks.apart.vehicles import Parameters

ROWS = 4000
"""Number of rows of every session."""
STREAMS = {"fit": 1, "before": 2, "after": 3}
NOISE = np.array([2e-3] * 3 + [1e-3] * 3 + [5e-3] * 3 + [1.5e-3] * 3)
"""Standard deviations of the noise: position [m], attitude [rad], velocity [m/s], rates [rad/s]."""
AHEAD = 250
"""Number of rows of a prediction that shows the size of an effect: 5 s."""
COLUMNS = ("x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r")


@dataclass(frozen=True)
class Flown:
    """One session, all rows.

    Attributes:
        states: States of the simulator (rows, 29 + n), for n thrusters.
        commands: (rows, n).
        measured: Position, attitude and velocity (rows, 12), FRD and NED, with noise.
        noise: Noise in `measured` (rows, 12).
    """

    states: Array
    commands: Array
    measured: Array
    noise: Array


@dataclass(frozen=True)
class Recording:
    """Sessions of one case to fly.

    Attributes:
        drawn: The case.
        name: `fit`, `before` or `after`.
        P: Parameters of the simulated vehicle; None for a recording that only takes its part of the noise.
    """

    drawn: Drawn
    name: str
    P: Parameters | None

    @property
    def legs(self) -> list[Leg]:
        """Return the flight plan of each session."""
        drawn = self.drawn
        after = self.name == "after"
        depth, excursion = (drawn.depth, drawn.excursion) if after else (MIDDLE, 3.0)
        legs = []
        for number, mode in enumerate(drawn.modes[self.name]):
            rng = drawn.rng(STREAMS[self.name], number)
            heading = rng.uniform(-np.pi, np.pi)
            x, y, z = rng.uniform(-3, 3), rng.uniform(-3, 3), depth + rng.uniform(-1, 1)
            legs.append(Leg(drawn.vehicle, mode, rng, (x, y, z, heading), excursion))
        return legs


def fly(
    recordings: Sequence[Recording], seed: int, told: Callable[[str], None] = lambda line: None
) -> dict[tuple[int, str], list[Flown]]:
    """Fly recordings.

    Args:
        recordings: All recordings that share batches, those without parameters too, in the order of their
            cases.
        seed: Seed of the noise.
        told: Called with a line per batch.

    Returns:
        Sessions of every recording that has parameters, by place of the case and name.
    """
    batches: dict[tuple[str, int], list[Recording]] = {}
    for each in recordings:
        batches.setdefault((each.drawn.vehicle.kind, each.drawn.vehicle.n), []).append(each)
    found: dict[tuple[int, str], list[Flown]] = {}
    for (kind, n), batch in batches.items():
        whole = [(each, leg) for each in batch for leg in each.drawn.modes[each.name]]
        chosen = np.array([each.P is not None for each, _ in whole])
        if not chosen.any():
            continue
        rng = np.random.default_rng([seed, 99, len(whole), n])
        noise = (rng.normal(0, 1, (ROWS, len(whole), 12)) * NOISE)[:, chosen]
        flown = [(each, leg) for each in batch if each.P is not None for leg in each.legs]
        told(f"{kind} with {n} commands: {len(flown)} sessions of {len(whole)}")
        simulator = Simulator(kind, [each.P or {} for each, _ in flown])
        start = np.array([leg.start for _, leg in flown])
        level = np.zeros((len(flown), 3))
        level[:, 2] = start[:, 3]
        x = simulator.initial(start[:, :3], level, np.zeros((len(flown), 6)))
        states, commands, measured = simulator.run(x, ROWS, Pilot([leg for _, leg in flown], ROWS), noise)
        for b, (each, _) in enumerate(flown):
            sessions = found.setdefault((each.drawn.place, each.name), [])
            sessions.append(Flown(states[:, b], commands[:, b], measured[:, b], noise[:, b]))
    return found


def effect(P: Parameters, kind: str, flown: Sequence[Flown], rows: Sequence[int]) -> Array:
    """Return the root mean square effect (6,) of a change on the velocity 5 s ahead [m/s, rad/s].

    Args:
        P: Parameters of the unchanged vehicle, which is flown from states of the changed one.
        kind: Kind of its hull.
        flown: Sessions of the changed vehicle.
        rows: Number of rows that are kept of each session.
    """
    starts, commands, ends, past = [], [], [], []
    for each, count in zip(flown, rows, strict=True):
        for k in range(150, count - AHEAD - 1, 300):
            starts.append(each.states[k])
            commands.append(each.commands[k : k + AHEAD + 1])
            ends.append(each.states[k + AHEAD, 7:13])
            past.append(each.commands[k - 1])
    given = np.array(commands)
    simulator = Simulator(kind, [P] * len(starts))
    out, _, _ = simulator.run(np.array(starts), AHEAD + 1, lambda k, m: given[:, k], past=np.array(past))
    return np.sqrt(np.mean((out[AHEAD, :, 7:13] - np.array(ends)) ** 2, 0))


def table(flown: Sequence[Flown], rows: Sequence[int], truth: Mapping[str, Any], prefix: str) -> pl.DataFrame:
    """Return a raw table of sessions, with the true faults of sensors and command columns.

    Args:
        flown: Sessions.
        rows: Number of rows that are kept of each session.
        truth: True values of a change: `sensor` and its size, or the `columns` exchanged (two) or reversed
            (one).
        prefix: Prefix of the sessions' names.
    """
    frames = []
    for number, (each, count) in enumerate(zip(flown, rows, strict=True)):
        measured = sensed(each, count, truth)
        commands = logged(each.commands[:count], truth.get("columns", ()))
        columns = {"session": [f"{prefix}{number}"] * count, "t": np.arange(count) * ROW}
        columns |= {name: measured[:, i] for i, name in enumerate(COLUMNS)}
        columns |= {f"cmd_{i + 1}": commands[:, i] for i in range(commands.shape[1])}
        frames.append(pl.DataFrame(columns))
    return pl.concat(frames)


def sensed(flown: Flown, count: int, truth: Mapping[str, Any]) -> Array:
    """Return the measurements (count, 12) with errors of the DVL or the heading."""
    measured = flown.measured[:count].copy()
    fault = truth.get("sensor")
    if fault is None:
        return measured
    if fault == "heading":
        psi = measured[:, 5] + truth["bias"]
        measured[:, 5] = np.arctan2(np.sin(psi), np.cos(psi))
        return measured
    v = flown.states[:count, 7:10].copy()
    if fault == "scale":
        v *= 1 + truth["s"]
    elif fault == "yaw":
        c, s = np.cos(truth["alpha"]), np.sin(truth["alpha"])
        v = v @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])  # R^T v
    elif fault == "late":
        k = round(truth["d"] / ROW)
        v = np.concatenate([np.repeat(v[:1], k, 0), v[:-k]])
    measured[:, 6:9] = v + flown.noise[:count, 6:9]
    return measured


def logged(commands: Array, columns: Sequence[int]) -> Array:
    """Return commands (rows, n) with two columns exchanged or one reversed; columns are counted from 1."""
    commands = commands.copy()
    if len(columns) == 2:
        i, j = columns[0] - 1, columns[1] - 1
        commands[:, [i, j]] = commands[:, [j, i]]
    elif columns:
        commands[:, columns[0] - 1] *= -1
    return commands
