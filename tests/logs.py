"""Logs of other people: a motion known in closed form, written in any of their conventions.

Nothing of hydro computes anything here (a map only describes): frames are spelled out, rotations are scipy's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hydro.core.logs.logmap import Attitude, Commands, LogMap, Position, Rates, Time, Velocity

NAMES = ("x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r")
PLAIN = LogMap(
    time=Time("t"),
    position=Position(NAMES[:3]),
    attitude=Attitude(NAMES[3:6]),
    velocity=Velocity(NAMES[6:9]),
    rates=Rates(NAMES[9:]),
    commands=Commands(("cmd_1",)),
)
"""The map of such a motion with one command, in the conventions of hydro itself."""
PLAIN_TEXT = """
[time]
column = "t"
[position]
columns = ["x", "y", "z"]
[attitude]
columns = ["phi", "theta", "psi"]
[velocity]
columns = ["u", "v", "w"]
[rates]
columns = ["p", "q", "r"]
[commands]
columns = ["cmd_1", "cmd_2"]
"""
"""A map of a motion with two commands, in the conventions of hydro itself, as a file has it."""
ORDINARY = np.repeat([0.02, 0.001, 0.01, 0.002], 3)  # m, rad, m/s, rad/s


def motion(t: np.ndarray, still: tuple[int, ...] = ()) -> np.ndarray:
    """A smooth motion at depth on all axes, (N, 12): velocity is the derivative of the pose, to rounding.

    Args:
        t: Times [s].
        still: Of the six axes of pose, those that do not move.
    """
    amplitude = np.array([4.0, 3.0, 1.5, 0.12, 0.15, 2.2])
    frequency = np.array([0.21, 0.27, 0.33, 0.61, 0.47, 0.11])
    amplitude[list(still)] = 0.0
    phase = frequency * t[:, None] + np.arange(6)
    eta = np.array([1.0, 2.0, 12.0, 0.02, -0.03, 0.9]) + amplitude * np.sin(phase)
    rate = amplitude * frequency * np.cos(phase)
    R = Rotation.from_euler("ZYX", eta[:, [5, 4, 3]])
    velocity = R.inv().apply(rate[:, :3])
    phi, theta = eta[:, 3], eta[:, 4]
    p = rate[:, 3] - np.sin(theta) * rate[:, 5]
    q = np.cos(phi) * rate[:, 4] + np.sin(phi) * np.cos(theta) * rate[:, 5]
    r = -np.sin(phi) * rate[:, 4] + np.cos(phi) * np.cos(theta) * rate[:, 5]
    eta[:, 5] = np.angle(np.exp(1j * eta[:, 5]))
    return np.column_stack([eta, velocity, p, q, r])


def raw(
    seconds: float = 60.0,
    rate: float = 50.0,
    noise: np.ndarray | float = 0.0,
    still: tuple[int, ...] = (),
    sessions: tuple[str, ...] = ("dive",),
    seed: int = 0,
) -> pl.DataFrame:
    """A raw table of that motion, with two thrusters that step every half second."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    parts = []
    for number, name in enumerate(sessions):
        values = motion(t + 100.0 * number, still) + noise * rng.standard_normal((len(t), 12))
        steps = np.floor(2.0 * t + 1e-9)
        drive = np.stack([np.round(np.sin(steps), 2), np.round(np.cos(1.7 * steps), 2)], axis=1)
        columns = dict(zip(NAMES, values.T, strict=True))
        parts.append(
            pl.DataFrame(
                {"session": [name] * len(t), "t": t, **columns, "cmd_1": drive[:, 0], "cmd_2": drive[:, 1]}
            )
        )
    return pl.concat(parts)


@dataclass(frozen=True)
class Convention:
    """How somebody writes a log."""

    time: str = "s"
    position: str = "NED"
    depth: str = ""
    attitude: tuple[str, str] = ("NED", "FRD")
    angles: str = "rad"
    velocity: str = "FRD"
    rates: str = "FRD"
    turn: str = "rad/s"
    commands: str = "1"
    reverse: bool = False


ROS = Convention(
    position="ENU", attitude=("ENU", "FLU"), angles="xyzw", velocity="FLU", rates="FLU", commands="percent"
)

conventions = st.builds(
    Convention,
    time=st.sampled_from(["s", "ms", "us", "ns", "iso"]),
    position=st.sampled_from(["NED", "ENU", "NWU"]),
    depth=st.sampled_from(["", "depth", "height"]),
    attitude=st.tuples(st.sampled_from(["NED", "ENU", "NWU"]), st.sampled_from(["FRD", "FLU"])),
    angles=st.sampled_from(["rad", "deg", "wxyz", "xyzw", "XYZ", "inverse"]),
    velocity=st.sampled_from(["FRD", "FLU", "NED", "ENU", "NWU"]),
    rates=st.sampled_from(["FRD", "FLU"]),
    turn=st.sampled_from(["rad/s", "deg/s"]),
    commands=st.sampled_from(["1", "percent", "pwm"]),
    reverse=st.booleans(),
)


def turned(values: np.ndarray, frame: str) -> np.ndarray:
    """Vectors in NED or FRD written along the axes of `frame`."""
    a, b, c = values.T
    spelled = {"NED": (a, b, c), "ENU": (b, a, -c), "NWU": (a, -b, -c), "FRD": (a, b, c), "FLU": (a, -b, -c)}
    return np.stack(spelled[frame], axis=1)


def matrix(frame: str) -> np.ndarray:
    """The rotation that `turned` applies."""
    return turned(np.eye(3), frame).T


def written(raw: pl.DataFrame, how: Convention) -> tuple[pl.DataFrame, dict[str, Any]]:
    """A raw table as a log of that convention, and the map that reads it."""
    values = raw.select(NAMES).to_numpy()
    log: dict[str, Any] = {"run": raw["session"], "clock": clock(raw["t"].to_numpy(), how.time)}
    spec: dict[str, Any] = {"time": {"column": "clock", "unit": how.time}, "session": {"column": "run"}}

    position = turned(values[:, :3], how.position)
    log |= dict(zip(("east", "north", "up"), position.T, strict=True))
    spec["position"] = {"columns": ["east", "north", "up"], "world": how.position}
    if how.depth:
        log |= {"up": {"depth": 1.0, "height": -1.0}[how.depth] * values[:, 2]}
        spec["position"] = {"columns": ["east", "north"], "world": how.position, how.depth: "up"}

    world, body = how.attitude
    plain = Rotation.from_euler("ZYX", values[:, [5, 4, 3]]).as_matrix()
    R = Rotation.from_matrix(matrix(world) @ plain @ matrix(body).T)
    block: dict[str, Any] = {"world": world, "body": body}
    if how.angles in ("rad", "deg", "XYZ"):
        order = "XYZ" if how.angles == "XYZ" else "ZYX"
        angles = R.as_euler(order, degrees=how.angles == "deg")
        named = {axis: angles[:, i] for i, axis in enumerate(order)}
        log |= {"roll": named["X"], "pitch": named["Y"], "heading": named["Z"]}
        block |= {"columns": ["roll", "pitch", "heading"], "order": order}
        block |= {"unit": "deg"} if how.angles == "deg" else {}
    else:
        x, y, z, w = (R.inv() if how.angles == "inverse" else R).as_quat().T
        log |= {"q0": w, "q1": x, "q2": y, "q3": z}
        block |= {
            "quaternion": ["q1", "q2", "q3", "q0"] if how.angles == "xyzw" else ["q0", "q1", "q2", "q3"]
        }
        block |= {"layout": "xyzw" if how.angles == "xyzw" else "wxyz"}
        block |= {"turns": "world to body"} if how.angles == "inverse" else {}
    spec["attitude"] = block

    along = (
        values[:, 6:9] if how.velocity in ("FRD", "FLU") else np.einsum("nij,nj->ni", plain, values[:, 6:9])
    )
    log |= dict(zip(("v1", "v2", "v3"), turned(along, how.velocity).T, strict=True))
    spec["velocity"] = {"columns": ["v1", "v2", "v3"], "frame": how.velocity}

    spin = turned(values[:, 9:], how.rates) * (180.0 / np.pi if how.turn == "deg/s" else 1.0)
    log |= dict(zip(("g1", "g2", "g3"), spin.T, strict=True))
    spec["rates"] = {"columns": ["g1", "g2", "g3"], "frame": how.rates, "unit": how.turn}

    drive = raw.select("cmd_1", "cmd_2").to_numpy() * ([1.0, -1.0] if how.reverse else 1.0)
    scaled = {
        "1": drive,
        "percent": 100.0 * drive,
        "pwm": 1480.0 + np.where(drive > 0.0, 420.0, 380.0) * drive,
    }[how.commands]
    log |= {"s1": scaled[:, 0], "s2": scaled[:, 1]}
    second: Any = {"column": "s2", "reverse": True} if how.reverse else "s2"
    spec["commands"] = {"columns": ["s1", second], "unit": how.commands}
    if how.commands == "pwm":
        spec["commands"]["pwm"] = {"min": 1100.0, "neutral": 1480.0, "max": 1900.0}
    return pl.DataFrame(log), spec


def clock(t: np.ndarray, unit: str) -> pl.Series:
    """Times since the start as an epoch's numbers or text."""
    if unit == "s":
        return pl.Series(t + 5000.0)
    whole = np.round(t * 1e9).astype(np.int64) + 1_750_000_000_000_000_000
    if unit == "iso":
        return pl.Series(whole).cast(pl.Datetime("ns")).dt.strftime("%Y-%m-%dT%H:%M:%S%.6fZ")
    return pl.Series(whole // {"ms": 10**6, "us": 10**3, "ns": 1}[unit])


def wrongly(how: Convention, **declared: Any) -> dict[str, Any]:
    """The map of somebody who believes another convention of the same columns."""
    return written(raw(0.1), replace(how, **declared))[1]
