"""Time and memory of `hydro import` for a bag, compared with its reader library.

The benchmark writes a ROS 1 bag of a given size: odometry and IMU at 100 Hz, commands at 50 Hz.  Each case
reads it in its own process, which gives its peak memory.  All cases run in alternation.

    library    `rosbags` deserialises every message and keeps none: the lower bound.
    kept       The same, and the numbers of each message are appended to lists, as in a script.
    read       `hydro.io.log.read` with the columns of the map.
    import     `hydro.import_log`: read, resample, check the conventions.

    python -m benchmarks.import_speed --megabytes 1000 --rounds 1
"""

from __future__ import annotations

import argparse
import datetime
import gc
import multiprocessing
import shutil
import struct
import sys
import tempfile
import time
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks import kept_tables

KINDS = {
    "/odom": "nav_msgs/msg/Odometry",
    "/imu": "sensor_msgs/msg/Imu",
    "/cmd": "std_msgs/msg/Float64MultiArray",
}
BEGUN, TURN = 1_700_000_000, 0.5  # s since 1970; rad/s
NOISE = 1e-3
"""Noise of velocity [m/s] and rates [rad/s], since identical readings count as repeated, not as new ones."""
MOST = 1000
"""Maximum size of a bag [MB]."""
RATE, EVERY = 100.0, 2  # Hz of odometry and IMU; a command at each second of them
CASES = ("library", "kept", "read", "import")
_AXES = ("x", "y", "z")
ODOMETRY = [f"pose.pose.position.{axis}" for axis in _AXES] + [f"twist.twist.linear.{axis}" for axis in _AXES]
IMU = [f"orientation.{axis}" for axis in (*_AXES, "w")] + [f"angular_velocity.{axis}" for axis in _AXES]
COMMANDS = [f"/cmd.data[{number}]" for number in range(8)]
MAP = f"""
time.column = "time"
position.columns = {[f"/odom.{name}" for name in ODOMETRY[:3]]}
attitude = {{quaternion = {[f"/imu.{name}" for name in IMU[:4]]}, layout = "xyzw"}}
velocity.columns = {[f"/odom.{name}" for name in ODOMETRY[3:]]}
rates.columns = {[f"/imu.{name}" for name in IMU[4:]]}
commands.columns = {COMMANDS}
"""


def make(path: Path, megabytes: float) -> int:
    """Write a bag of the given size for a circling vehicle; return the number of messages.

    One circle is serialised and repeated with new stamps, so a gigabyte needs little time and memory.
    """
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    circle = _circle(types)
    row = messages = written = 0
    with Writer(path) as writer:
        links = {topic: writer.add_connection(topic, kind, typestore=types) for topic, kind in KINDS.items()}
        while written < megabytes * 1e6:
            ns = BEGUN * 10**9 + round(row / RATE * 1e9)
            stamp = struct.pack("<III", row, *divmod(ns, 10**9))
            for topic, data in circle[row % len(circle)]:
                if topic != "/cmd":
                    data = stamp + data[len(stamp) :]
                writer.write(links[topic], ns, data)
                written += len(data)
                messages += 1
            row += 1
    return messages


def _circle(types: Any) -> list[list[tuple[str, bytes]]]:
    """Return topics and messages of every row of one circle; headers begin with number and stamp."""
    new = types.types
    empty, still = np.zeros(36), new["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    layout = new["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    head = new["std_msgs/msg/Header"](seq=0, stamp=new["builtin_interfaces/msg/Time"](0, 0), frame_id="odom")
    vector, noise = new["geometry_msgs/msg/Vector3"], np.random.default_rng(0)
    rows = 2 * round(np.pi / TURN * RATE)
    out = []
    for row in range(rows):
        turn = 2.0 * np.pi * row / rows
        spin = vector(*np.array([0.0, 0.0, TURN]) + NOISE * noise.standard_normal(3))
        ahead = vector(*np.array([1.0, 0.0, 0.0]) + NOISE * noise.standard_normal(3))
        twist = new["geometry_msgs/msg/TwistWithCovariance"](
            new["geometry_msgs/msg/Twist"](ahead, spin), empty
        )
        place = new["geometry_msgs/msg/Point"](np.sin(turn) / TURN, (1.0 - np.cos(turn)) / TURN, 3.0)
        quaternion = new["geometry_msgs/msg/Quaternion"](0.0, 0.0, np.sin(0.5 * turn), np.cos(0.5 * turn))
        pose = new["geometry_msgs/msg/PoseWithCovariance"](
            new["geometry_msgs/msg/Pose"](place, quaternion), empty
        )
        batch: dict[str, Any] = {
            "/odom": new[KINDS["/odom"]](head, "base", pose, twist),
            "/imu": new[KINDS["/imu"]](head, quaternion, empty[:9], spin, empty[:9], still, empty[:9]),
        }
        if row % EVERY == 0:
            batch["/cmd"] = new[KINDS["/cmd"]](layout, np.full(8, 0.1 * np.sin(row / RATE)))
        out.append(
            [(topic, bytes(types.serialize_ros1(each, KINDS[topic]))) for topic, each in batch.items()]
        )
    return out


def library(path: Path, keep: bool) -> int:
    """Read every message with `rosbags` alone; return their number.

    Args:
        path: The bag.
        keep: Whether the numbers of each message are appended to lists.
    """
    from rosbags.rosbag1 import Reader
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    take = {
        "/odom": attrgetter(*ODOMETRY),
        "/imu": attrgetter(*IMU),
        "/cmd": lambda message: message.data.tolist(),
    }
    kept: dict[str, list[Any]] = {topic: [] for topic in take}
    count = 0
    with Reader(path) as reader:
        for link, _, raw in reader.messages():
            message = types.deserialize_ros1(raw, link.msgtype)
            if keep:
                kept[link.topic].append(take[link.topic](message))
            count += 1
    return count


def measured(case: str, path: Path, results: Any) -> None:
    """Run a case in this process; put time [s], peak and growth of memory [MB] and count into `results`."""
    import hydro
    from hydro.io import log, logmap

    meaning = logmap.parse(MAP)
    _warm(path.with_name("warm.bag"), meaning)
    gc.collect()
    Path("/proc/self/clear_refs").write_text("5")  # reset the peak
    before, shares, begun = _memory("VmRSS"), [], time.process_time()
    if case in ("library", "kept"):
        count = library(path, case == "kept")
    elif case == "read":
        wanted = [f"/odom.{name}" for name in ODOMETRY] + [f"/imu.{name}" for name in IMU] + COMMANDS
        with log.opened(path) as file:
            count = file.read(wanted, shares.append).table.height
        assert len(shares) > 1, "progress is reported"
        assert shares == sorted(shares)
    else:
        count = hydro.import_log(path, meaning)[0].height
    seconds = time.process_time() - begun
    peak = _memory("VmHWM")
    results.put((seconds, peak, peak - before, count))


def _memory(name: str) -> float:
    """Return a memory figure of this process from the kernel [MB]."""
    (line,) = [each for each in Path("/proc/self/status").read_text().splitlines() if each.startswith(name)]
    return float(line.split()[1]) / 1e3


def _warm(path: Path, meaning: Any) -> None:
    """Run every case once on a short bag, to load libraries and compile kernels."""
    import hydro

    library(path, True)
    hydro.import_log(path, meaning)


def run(megabytes: float, rounds: int, cases: Sequence[str] = CASES) -> pl.DataFrame:
    """Measure processor time and memory of each case in each round."""
    context, rows = multiprocessing.get_context("spawn"), []
    with tempfile.TemporaryDirectory() as folder:
        if shutil.disk_usage(folder).free < 2e6 * megabytes:
            raise SystemExit(f"{folder}: less than twice the bag's {megabytes:.0f} MB are free")
        path = Path(folder) / "dive.bag"
        make(Path(folder) / "warm.bag", 1.0)
        messages = make(path, megabytes)
        size = path.stat().st_size / 1e6
        for number in range(rounds):
            for case in cases[:: 1 - 2 * (number % 2)]:
                results = context.Queue()
                process = context.Process(target=measured, args=(case, path, results))
                process.start()
                seconds, peak, growth, _ = results.get()
                process.join()
                rows.append((case, number, size, messages, seconds, peak, growth))
                print(f"{case}: {seconds:.1f} s, {growth:.0f} MB", file=sys.stderr, flush=True)
    names = ["case", "round", "megabytes", "messages", "seconds", "peak_mb", "growth_mb"]
    return pl.DataFrame(rows, schema=names, orient="row")


def summary(rows: pl.DataFrame) -> pl.DataFrame:
    """Return medians over the rounds, and times relative to the time of `library` in the same round."""
    floor = rows.filter(case="library").select("round", pl.col("seconds").alias("floor"))
    beside = rows.join(floor, on="round").with_columns(ratio=pl.col("seconds") / pl.col("floor"))
    return beside.group_by("case", maintain_order=True).agg(
        pl.col("messages").first(), pl.col("seconds", "ratio", "peak_mb", "growth_mb").median()
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--megabytes", type=float, default=20.0, help=f"size of the bag, at most {MOST}")
    parser.add_argument("--rounds", type=int, default=3, help="number of runs of every case")
    parser.add_argument("-o", "--output", type=Path, help="write a table with a row per case and round")
    parser.add_argument(
        "--cases", nargs="*", choices=CASES, default=CASES, help="cases to run; must include library"
    )
    parser.add_argument(
        "--keep", metavar="COMMIT", help="write benchmarks/results for this commit of the code"
    )
    given = parser.parse_args()
    if not 0.0 < given.megabytes <= MOST:
        parser.error(f"--megabytes must be above 0 and at most {MOST}")
    if "library" not in given.cases:
        parser.error("--cases must include library: all cases are compared with it")
    rows = run(given.megabytes, given.rounds, given.cases)
    if given.output is not None:
        rows.write_parquet(given.output)
    print(f"bag of {rows['megabytes'][0]:.0f} MB")
    cells = kept(rows)
    print(kept_tables.markdown(cells))
    if given.keep is not None:
        command = f"python -m benchmarks.import_speed --megabytes {given.megabytes:g} --rounds {given.rounds}"
        command += f" --cases {' '.join(given.cases)}" if tuple(given.cases) != CASES else ""
        origin = {"commit": given.keep, "recorded": "", "date": datetime.date.today().isoformat()}
        origin |= {"command": command, "seeds": "not used"}
        kept_tables.keep("import_speed", [{**each, **origin} for each in cells])


WORDS = {
    "library": "`rosbags` deserialises every message and keeps none",
    "kept": "the same, and a script appends the numbers to lists",
    "read": "`hydro.io.log.read`, the columns of the map",
    "import": "`hydro.import_log`: read, one clock, conventions and clocks checked",
}


def kept(rows: pl.DataFrame) -> list[dict[str, str]]:
    """Return the summary as rows of the results table."""
    size = f"{rows['megabytes'][0]:,.0f} MB"
    return [
        {
            "reading": WORDS[case],
            "bag": f"{size}; {messages:,} messages",
            "processor time": f"{seconds:.1f} s",
            "relative to the library": f"{ratio:.2f}",
            "peak memory": f"{peak:,.0f} MB",
            "of this for the log": f"{growth:,.0f} MB",
        }
        for case, messages, seconds, ratio, peak, growth in summary(rows).iter_rows()
    ]


if __name__ == "__main__":
    main()
