"""Make the example logs: python datasets/make_logs.py.

`dive/` has one dive in every format that `hydro import` reads: see `dive.py` and `dive_logs.py`.
`logs/example.csv` is a plainer log.  A small ROV, simulated from its vehicle file, as its computer might log
it: attitude, gyroscope and pulse widths at 20 Hz, position and Doppler velocity at 5 Hz with empty cells
between, a clock in milliseconds that jitters, and a second run in which the log stopped for three seconds.
All maps are written by hand.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import dive_logs
import log_writers
import numpy as np
import polars as pl
from dive import dive

from hydro.core.columns import POSE, VELOCITY
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.thrusters import allocate, configuration_matrix
from hydro.io import vehicle as vehicles

HERE = Path(__file__).parent
RATE, SLOW, SECONDS = 20.0, 4, 34.0
RUNS = ("run-1", "run-2")
DEMAND = np.array([26.0, 20.0, 16.0, 0.0, 0.0, 1.0])  # N, N m
DEPTH = 4.0
CUT, SHORTEST = 30.0, 12.0
"""Seconds of the dive that other formats have, and the one that is not compressed."""


def main() -> None:
    """Write logs/example.csv and the logs of dive/."""
    make_example()
    make_dive(HERE / "dive")


def make_dive(folder: Path) -> None:
    """Write the dive in every format."""
    whole = dive()
    short = whole.first(CUT)
    types = dive_logs.DEFINITIONS
    log_writers.ros1(folder / "dive.bag", dive_logs.mavros(whole), types, "BZ2")
    log_writers.dataflash(folder / "dive.bin", dive_logs.autopilot(whole), dive_logs.DATAFLASH)
    log_writers.telemetry(folder / "cut.tlog", dive_logs.telemetry(short))
    log_writers.json_mcap(folder / "blueos.mcap", dive_logs.blueos(short))
    for storage, suffix, seconds in (("MCAP", "mcap", CUT), ("SQLITE3", "db3", SHORTEST)):
        with tempfile.TemporaryDirectory() as made:
            messages = dive_logs.mavros(whole.first(seconds))
            log_writers.ros2(Path(made) / "ros2", messages, types, storage)
            shutil.move(Path(made) / "ros2" / f"ros2.{suffix}", folder / f"ros2.{suffix}")
    dive_logs.write_npz(folder / "cut.npz", dive_logs.arrays(short))
    dive_logs.write_mat(folder / "cut.mat", dive_logs.arrays(short))


def make_example() -> None:
    """Write logs/example.csv."""
    rover, _ = vehicles.read(HERE / "logs" / "rov.toml")
    rng = np.random.default_rng(151)
    parts = []
    for number, name in enumerate(RUNS):
        t = np.arange(round(SECONDS * RATE)) / RATE
        swing = np.array([0.6, 0.5, 0.7, 1.0, 1.0, 0.4]) * (1.0 + 0.3 * number)
        tau = DEMAND * np.sin(np.outer(t, swing) + np.arange(6) * (1.0 + number))
        limit = np.array([thruster.max_thrust for thruster in rover.thruster])
        pulses = np.round(
            1500.0 + 400.0 * np.clip(allocate(configuration_matrix(rover), tau) / limit, -1.0, 1.0)
        )
        columns = {f"cmd_{i + 1}": (pulses[:, i] - 1500.0) / 400.0 for i in range(len(limit))}
        flown = simulate(rover, pl.DataFrame({"session": name, "t": t, **columns}))
        motion = flown.select(*POSE, *VELOCITY).to_numpy()
        motion[:, 2] += DEPTH
        clock = np.round(1000.0 * (t + rng.uniform(0.0, 0.002, t.size)) + 60_000.0 * number).astype(int)
        part = _logged(name, clock, disturb(motion, PROFILES["ordinary"], rng), pulses)
        if number:
            part = part.filter(~pl.Series(t).is_between(20.0, 23.0))
        parts.append(part)
    pl.concat(parts).write_csv(HERE / "logs" / "example.csv", float_precision=3, null_value="")


def _logged(name: str, clock: np.ndarray, motion: np.ndarray, pulses: np.ndarray) -> pl.DataFrame:
    """One run in the ROV's own columns: degrees, forward-left-up Doppler velocity, pulse widths."""
    x, y, z, phi, theta, psi, u, v, w, p, q, r = motion.T
    rare = np.arange(clock.size) % SLOW == 0
    seldom = {"east": y, "north": x, "depth": z, "dvl_x": u, "dvl_y": -v, "dvl_z": -w}
    often = {
        "roll": phi,
        "pitch": theta,
        "yaw": np.mod(psi, 2.0 * np.pi),
        "gyro_x": p,
        "gyro_y": q,
        "gyro_z": r,
    }
    return pl.DataFrame(
        {
            "run": name,
            "time_ms": clock,
            **{
                f"{key}_m" if key in ("east", "north", "depth") else key: _only(rare, seldom[key])
                for key in seldom
            },
            **{f"{key}_{'deg_s' if 'gyro' in key else 'deg'}": np.degrees(often[key]) for key in often},
            **{f"servo{i + 1}_raw": pulses[:, i].astype(int) for i in range(pulses.shape[1])},
        }
    )


def _only(there: np.ndarray, values: np.ndarray) -> pl.Series:
    """The values of some rows, and empty cells."""
    return pl.Series(values).set(pl.Series(~there), None)


if __name__ == "__main__":
    main()
