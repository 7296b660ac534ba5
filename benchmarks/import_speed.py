"""How long does `hydro import` take to read a bag, beside its library, and in how much memory?

A ROS 1 bag of a given size is made: odometry and an IMU 100 times a second, commands 50 times.  Each case
reads it in a process of its own, so that peak memory is its own; all in one run, in turning
order:

    library    `rosbags` deserialises every message and keeps none: the floor
    kept       the same, and the 15 numbers of each are appended to lists, as a script would
    read       `hydro.io.log.read` with the columns of the map
    import     `hydro.import_log`: read, resample, check the conventions

    python benchmarks/import_speed.py --megabytes 200 -o import.parquet
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import tempfile
import time
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

MOST = 1000
"""Megabytes of the largest bag."""
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
    """Write a bag of that size of a vehicle that circles; how many messages it has."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    new = types.types
    kinds = {
        "/odom": "nav_msgs/msg/Odometry",
        "/imu": "sensor_msgs/msg/Imu",
        "/cmd": "std_msgs/msg/Float64MultiArray",
    }
    empty, still = np.zeros(36), new["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    layout = new["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    row = messages = written = 0
    with Writer(path) as writer:
        links = {topic: writer.add_connection(topic, kind, typestore=types) for topic, kind in kinds.items()}
        while written < megabytes * 1e6:
            t = row / RATE
            ns = 1_700_000_000 * 10**9 + round(t * 1e9)
            stamp = new["builtin_interfaces/msg/Time"](*divmod(ns, 10**9))
            head = new["std_msgs/msg/Header"](seq=row, stamp=stamp, frame_id="odom")
            turn, w = 0.5 * t, 0.5
            place = new["geometry_msgs/msg/Point"](2.0 * np.sin(turn), 2.0 - 2.0 * np.cos(turn), 3.0)
            quaternion = new["geometry_msgs/msg/Quaternion"](0.0, 0.0, np.sin(0.5 * turn), np.cos(0.5 * turn))
            pose = new["geometry_msgs/msg/PoseWithCovariance"](
                new["geometry_msgs/msg/Pose"](place, quaternion), empty
            )
            spin, ahead = (
                new["geometry_msgs/msg/Vector3"](0.0, 0.0, w),
                new["geometry_msgs/msg/Vector3"](1.0, 0.0, 0.0),
            )
            twist = new["geometry_msgs/msg/TwistWithCovariance"](
                new["geometry_msgs/msg/Twist"](ahead, spin), empty
            )
            batch: list[tuple[str, Any]] = [
                ("/odom", new[kinds["/odom"]](head, "base", pose, twist)),
                ("/imu", new[kinds["/imu"]](head, quaternion, empty[:9], spin, empty[:9], still, empty[:9])),
            ]
            if row % EVERY == 0:
                batch.append(("/cmd", new[kinds["/cmd"]](layout, np.full(8, 0.1 * np.sin(t)))))
            for topic, message in batch:
                data = types.serialize_ros1(message, kinds[topic])
                writer.write(links[topic], ns, data)
                written += len(data)
                messages += 1
            row += 1
    return messages


def library(path: Path, keep: bool) -> int:
    """Read every message with `rosbags` alone."""
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
    """Run a case in this process: seconds, growth of memory [MB] and messages or rows."""
    import hydro
    from hydro.io import log, logmap

    meaning = logmap.parse(MAP)
    _warm(path.with_name("warm.bag"), meaning)
    before, begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
    if case in ("library", "kept"):
        count = library(path, case == "kept")
    elif case == "read":
        wanted = [f"/odom.{name}" for name in ODOMETRY] + [f"/imu.{name}" for name in IMU] + COMMANDS
        count = log.read(path, wanted).frame.height
    else:
        count = hydro.import_log(path, meaning)[0].height
    seconds = time.perf_counter() - begun
    results.put((seconds, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e3, count))


def _warm(path: Path, meaning: Any) -> None:
    """Load and compile all that any case needs, on a bag of a few seconds."""
    import hydro

    library(path, True)
    hydro.import_log(path, meaning)


def run(megabytes: float, rounds: int) -> pl.DataFrame:
    """Seconds and memory of each case in each round."""
    context, rows = multiprocessing.get_context("spawn"), []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "dive.bag"
        make(Path(folder) / "warm.bag", 1.0)
        messages = make(path, megabytes)
        size = path.stat().st_size / 1e6
        for number in range(rounds):
            for case in CASES[number % 2 :: 1] + CASES[: number % 2]:
                results = context.Queue()
                process = context.Process(target=measured, args=(case, path, results))
                process.start()
                seconds, memory, _ = results.get()
                process.join()
                rows.append((case, number, size, messages, seconds, memory))
    names = ["case", "round", "megabytes", "messages", "seconds", "memory_mb"]
    return pl.DataFrame(rows, schema=names, orient="row")


def summary(rows: pl.DataFrame) -> pl.DataFrame:
    """Medians over the rounds, and times beside the library's of the same round."""
    floor = rows.filter(case="library").select("round", pl.col("seconds").alias("floor"))
    beside = rows.join(floor, on="round").with_columns(ratio=pl.col("seconds") / pl.col("floor"))
    return beside.group_by("case", maintain_order=True).agg(
        pl.col("messages").first(), pl.col("seconds", "ratio", "memory_mb").median()
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--megabytes", type=float, default=20.0, help=f"size of the bag, at most {MOST}")
    parser.add_argument("--rounds", type=int, default=3, help="how often every case is timed")
    parser.add_argument("-o", "--output", type=Path, help="table of every case and round")
    given = parser.parse_args()
    if not 0.0 < given.megabytes <= MOST:
        parser.error(f"--megabytes must be above 0 and at most {MOST}")
    rows = run(given.megabytes, given.rounds)
    if given.output is not None:
        rows.write_parquet(given.output)
    print(f"bag of {rows['megabytes'][0]:.0f} MB")
    print("| case | messages | seconds | beside the library | memory [MB] |\n|---|---:|---:|---:|---:|")
    for case, messages, seconds, ratio, memory in summary(rows).iter_rows():
        print(f"| {case} | {messages:,} | {seconds:.2f} | {ratio:.2f} | {memory:.0f} |")


if __name__ == "__main__":
    main()
