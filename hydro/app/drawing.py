"""Arrays that the page draws, as JSON: curves of a window, the track, and the force of an effect."""

from __future__ import annotations

from typing import Any

import numpy as np

from hydro.app.live import Errors, Live, decimated
from hydro.app.session import Session
from hydro.core.columns import DOF, POSE, UNITS, VELOCITY, WRENCH, Array
from hydro.core.vehicle.description import Vehicle

ORDER = tuple(name for pair in zip(VELOCITY, POSE, strict=True) for name in pair)
"""Channels in the order of the page: each velocity, then the pose in the second column."""
PLACE = {name: i for i, name in enumerate((*POSE, *VELOCITY))}
TRACK_POINTS = 3000
"""Maximum number of points of the track: more than a screen has in its width."""
FORCE_POINTS = 900
"""Maximum number of points of the force of an effect in a card."""
BAND_POINTS = 300
"""Maximum number of points of the band of the noise floor, which is drawn up and back."""
FIRST_WINDOW = 60.0
"""Length of the first window [s]."""

Curve = dict[str, Any]


def curve(x: Array, y: Array, points: int) -> Curve:
    """Return a curve of at most about `points` points for JSON: its abscissae `x` and ordinates `y`.

    The least and the greatest value of each stretch are kept.

    Args:
        x: Abscissae, (N,).
        y: Ordinates, (N,).
        points: Maximum number of points.
    """
    x, y = decimated(x, y, points)
    return {"x": np.round(x, 3), "y": y.astype(np.float32)}


def predicted(live: Live, motion: Array, begin: int, points: int) -> list[Curve]:
    """Return the curves of predicted poses and velocities, a list in the order in which the page draws them.

    Args:
        live: The recording.
        motion: Pose and velocity of N rows (N, 12), NED and FRD [m, rad, m/s, rad/s].
        begin: Row of the recording to which the first row of `motion` belongs.
        points: Maximum number of points of a curve.
    """
    x = live.clock[begin : begin + len(motion)]
    return [curve(x, motion[:, PLACE[name]], points) for name in ORDER]


def redrawn(
    live: Live, vehicle: Vehicle, horizon: float | None, rows: tuple[int, int], points: int
) -> tuple[Errors, list[Curve]]:
    """Return what changes while a slider moves: the errors of a vehicle, and its curves in some rows.

    Args:
        live: The recording.
        vehicle: The vehicle.
        horizon: Prediction horizon [s]; None for whole segments.
        rows: First row, and row after the last.
        points: Maximum number of points of a curve.
    """
    motion = live.predicted(vehicle, horizon, *rows)
    return live.errors(vehicle, horizon), predicted(live, motion, rows[0], points)


def window(session: Session, vehicle: Vehicle, low: float, high: float, points: int) -> dict[str, Any]:
    """Return all curves between two times of the recording, as the page's script reads them.

    Args:
        session: The session.
        vehicle: The vehicle that is predicted.
        low: Begin of the window on the page's axis [s].
        high: End of the window on the page's axis [s].
        points: Maximum number of points of a curve.

    Returns:
        A dict of `window`, both times; and lists of curves `measured`, `band` (of the noise), `commands` and
        `predicted`.
    """
    live = session.live
    assert live is not None
    begin, end = live.rows(low, high)
    record, x, floors = live.record, live.clock[begin:end], session.floors()
    logged = live.windows.logged[begin:end].copy()
    if record.seen is not None:
        logged = np.where(record.seen[begin:end], logged, np.nan)
    breaks = np.flatnonzero(np.isin(np.arange(begin, end), record.segments[1:, 0]))
    logged[breaks] = np.nan
    motion = live.predicted(vehicle, session.horizon, begin, end)
    return {
        "window": [low, high],
        "measured": [curve(*_present(x, logged[:, PLACE[name]]), points) for name in ORDER],
        "band": [_band(x, logged[:, PLACE[name]], floors.get(name)) for name in ORDER],
        "commands": [curve(x, column, points) for column in record.commands[begin:end].T],
        "predicted": predicted(live, motion, begin, points),
    }


def begin(session: Session) -> dict[str, Any]:
    """Return the data that the page's script needs once for a recording.

    Returns:
        A dict of `end`, the last time [s]; `window`, the first range of time [s]; `hull`, its length, width
        and height [m]; `commands`, their number; `sessions` with start and name; and `track`, the measured
        poses.
    """
    live = session.live
    assert live is not None
    record, vehicle = live.record, session.present
    step = max(record.rows // TRACK_POINTS, 1)
    rows = np.arange(0, record.rows, step)
    segment = np.searchsorted(record.segments[:, 0], rows, side="right") - 1
    number = record.session[segment]
    names = dict(zip(record.session.tolist(), live.opened.log.sessions, strict=True))
    firsts = {
        int(record.session[i]): int(first) for i, first in reversed(list(enumerate(record.segments[:, 0])))
    }
    end = float(live.clock[-1])
    return {
        "end": end,
        "window": [0.0, min(FIRST_WINDOW, end)],
        "hull": [vehicle.hull.length, vehicle.hull.width, vehicle.hull.height],
        "commands": record.commands.shape[1],
        "sessions": [{"t": float(live.clock[firsts[i]]), "name": names[i]} for i in sorted(names)],
        "track": {
            "t": np.round(live.clock[rows], 3),
            "pose": np.round(record.eta[rows], 4),
            "session": number,
            "names": [names[i] for i in sorted(names)],
        },
    }


def force(live: Live, wrench: Array) -> dict[str, Any]:
    """Return the curves of an effect's force over time and against velocity, on its most affected axis.

    Args:
        live: The recording.
        wrench: Force of the effect along the recording, (N, 6) [N, N m].

    Returns:
        A dict of the axis `name` with its `unit`, the velocity `against` which it is drawn with its unit
        `speed`, and the curves `t` over time and `v` against that velocity.
    """
    size = np.sqrt((wrench**2).mean(axis=0)) / np.sqrt((live.record.nu**2).mean(axis=0) + 1e-9)
    axis = int(np.argmax(np.nan_to_num(size * live.opened.weights**-0.5)))
    speed = live.windows.nu[:, axis]
    rows = np.arange(0, len(speed), max(len(speed) // FORCE_POINTS, 1))
    return {
        "name": f"{WRENCH[axis]} ({DOF[axis]})",
        "unit": UNITS[WRENCH[axis]],
        "against": VELOCITY[axis],
        "speed": UNITS[VELOCITY[axis]],
        "t": curve(live.clock, wrench[:, axis], FORCE_POINTS),
        "v": {"x": speed[rows].astype(np.float32), "y": wrench[rows, axis].astype(np.float32)},
    }


def _present(x: Array, y: Array) -> tuple[Array, Array]:
    """Return a curve without the empty rows between the samples of a slow sensor."""
    there = np.isfinite(y)
    return (x, y) if there.mean() > 0.5 or not there.any() else (x[there], y[there])


def _band(x: Array, y: Array, floor: float | None) -> Curve:
    """Return the outline of a band of half width `floor` about a measured curve; empty if `floor` is None."""
    there = np.isfinite(y)
    if floor is None or not there.any():
        return {"x": [], "y": []}
    step = max(int(there.sum()) // BAND_POINTS, 1)
    u, v = x[there][::step], y[there][::step]
    return {
        "x": np.round(np.concatenate([u, u[::-1]]), 3),
        "y": np.concatenate([v + floor, (v - floor)[::-1]]).astype(np.float32),
    }
