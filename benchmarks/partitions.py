"""Memory for a folder of one and of many sessions, and labelling speed on two cluster nodes.

`make` writes sessions from the bundled recording, repeated with a little noise.  Their content is irrelevant,
only the number of rows matters.

`memory` labels one session as a file, the same session in a folder, and all of them in a folder.  Each runs
in its own process, and the peak resident memory is reported.

`speed` labels all of them in this process, on a cluster of one node, and on one of two, each with one warm
thread.  Rounds alternate.  Medians are reported for the time from the first task to the last result, and for
the tasks' processor time.

    python -m benchmarks.partitions make FOLDER --sessions 16 --rows 857542
    python -m benchmarks.partitions memory FOLDER
    python -m benchmarks.partitions speed FOLDER
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl

from benchmarks.nodes import nodes
from hydro.core import threads
from hydro.core.columns import VELOCITY, Array
from hydro.io import partitions, table
from hydro.io.files import bundled
from hydro.io.partitions import Dataset, Part
from hydro.study.cluster import Cluster
from hydro.study.engine import Engine, Here
from hydro.study.labelling import Labelling, label_part, shared, warm
from hydro.study.steps import apart

DT = 0.02
NOISE = (0.01, 0.01, 0.01, 0.002, 0.002, 0.002)
"""Standard deviations of the velocity noise [m/s, rad/s]."""
MEASURED = "import resource, sys; from hydro import cli; code = cli.main(sys.argv[1:]); \
use = resource.getrusage(resource.RUSAGE_SELF); \
print(use.ru_maxrss, use.ru_utime + use.ru_stime); sys.exit(code)"
"""Program that runs a command line, then prints its peak memory [KiB] and processor time [s]."""


def make(folder: Path, sessions: int, rows: int) -> None:
    """Write sessions of `rows` rows each."""
    whole = table.read(bundled("stonefish") / "sample.parquet", "raw")
    for number in range(sessions):
        rng = np.random.default_rng(number)
        taken = (np.arange(rows) + rng.integers(whole.frame.height)) % whole.frame.height
        name = f"s{number:02d}"
        noisy = [
            (pl.col(axis) + pl.Series(rng.normal(0.0, sd, rows))).cast(pl.Float32)
            for axis, sd in zip(VELOCITY, NOISE, strict=True)
        ]
        frame = whole.frame[taken].with_columns(
            *noisy, session=pl.lit(name), t=pl.Series(np.arange(rows) * DT)
        )
        target = partitions.place(folder, name)
        target.parent.mkdir(parents=True, exist_ok=True)
        made = table.make("raw", frame, stage="python", vehicle_text=whole.provenance.vehicle)
        table.write(made, target)


def peak(*line: str) -> tuple[float, float]:
    """Return the peak memory [MB] and processor time [s] of a command in its own process."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, *line], check=True, stdout=subprocess.PIPE, text=True
    )
    kilobytes, seconds = done.stdout.split()
    return int(kilobytes) * (1 if sys.platform == "darwin" else 1024) / 1e6, float(seconds)


def memory(folder: Path, vehicle: Path, rounds: int) -> None:
    """Label one session as a file, one in a folder, and all; print the medians."""
    data = partitions.opened(folder, ("raw",))
    first = data.parts[0]
    with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
        home = Path(scratch)
        alone = partitions.place(home / "one", first.session)
        alone.parent.mkdir(parents=True)
        os.link(first.path, alone)
        given = ("--vehicle", str(vehicle))
        cases = {
            "a file": ("labels", str(first.path), *given, "-o", str(home / "labels.parquet")),
            "a folder of 1": ("labels", str(home / "one"), *given, "-o", str(home / "of-one")),
            f"a folder of {len(data.parts)}": ("labels", str(folder), *given, "-o", str(home / "of-all")),
        }
        peak(*cases["a file"])  # compiles the kernels
        found: dict[str, list[tuple[float, float]]] = {name: [] for name in cases}
        for _ in range(rounds):
            for name, line in cases.items():
                found[name].append(peak(*line))
                shutil.rmtree(home / "of-all", ignore_errors=True)
        base = float(np.median([each[0] for each in found["a folder of 1"]]))
        print(f"sessions of {first.rows:,} rows; medians of {rounds} rounds")
        for name, measured in found.items():
            megabytes, seconds = np.median(measured, axis=0)
            print(f"{name:16} peak {megabytes:5.0f} MB, {megabytes / base:.2f}; processor {seconds:.1f} s")


def timed(part: Part, folder: Path, how: Labelling) -> tuple[str, float]:
    """Label a session; return its node and processor time [s]."""
    began = time.process_time()
    label_part(part, folder, how)
    spent = time.process_time() - began
    import ray  # after `benchmarks.nodes`, which sets the token of its clusters

    return ray.get_runtime_context().get_node_id() if ray.is_initialized() else "here", spent


def labelled(engine: Engine, data: Dataset, how: Labelling, scratch: Path) -> tuple[float, float, float]:
    """Return wall time, total processor time and that of the busiest node [s] for labelling all sessions.

    The nodes are warm: their kernels are compiled.
    """
    engine.prepare(partial(warm, data.parts[0], how))
    list(engine.each(timed, [(data.parts[0], scratch, how)] * engine.slots))  # starts the workers
    began = time.perf_counter()
    spent = Counter[str]()
    for node, seconds in engine.each(timed, [(part, scratch, how) for part in data.parts]):
        spent[node] += seconds
    return time.perf_counter() - began, spent.total(), max(spent.values())


def speed(folder: Path, vehicle: Path, rounds: int) -> None:
    """Label all sessions here, on one node and on two; print the medians."""
    os.environ[threads.VARIABLE] = "1"
    data = partitions.opened(folder, ("raw",))
    how = shared(data, Labelling(vehicle.read_text()))
    found: dict[str, list[tuple[float, float, float]]] = {"this process": [], "one node": [], "two nodes": []}
    with tempfile.TemporaryDirectory(dir=folder.parent) as scratch, nodes(1) as one, nodes(2) as two:
        clusters = {"one node": one, "two nodes": two}
        for cluster in clusters.values():
            cluster.wait()
        for _ in range(rounds):
            found["this process"].append(labelled(Here(apart), data, how, Path(scratch)))
            for name, cluster in clusters.items():
                with Cluster(cluster.address) as engine:
                    found[name].append(labelled(engine, data, how, Path(scratch)))
    each = {name: np.array(measured) for name, measured in found.items()}
    base = each["one node"]
    print(f"{len(data.parts)} sessions of {data.parts[0].rows:,} rows; medians of {rounds} rounds")
    for name, measured in each.items():
        wall, spent, busiest = np.median(measured, axis=0)
        times, shares = base[:, 0] / measured[:, 0], base[:, 2] / measured[:, 2]
        print(
            f"{name:13} {wall:6.1f} s, {told(times)} times as fast as one node, by the processor time of the "
            f"busiest node ({busiest:.1f} of {spent:.1f} s) {told(shares)}"
        )


def told(values: Array) -> str:
    """Return the median of some values, and their range, in words."""
    return f"{np.median(values):.2f} [{values.min():.2f}, {values.max():.2f}]"


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    top = argparse.ArgumentParser(prog="python -m benchmarks.partitions", description=__doc__.splitlines()[0])
    commands = top.add_subparsers(required=True)
    made = commands.add_parser("make", help="write sessions")
    made.add_argument("folder", type=Path)
    made.add_argument("--sessions", type=int, default=16)
    made.add_argument("--rows", type=int, default=857_542)
    made.set_defaults(action=lambda chosen: make(chosen.folder, chosen.sessions, chosen.rows))
    measured = commands.add_parser("memory", help="peak memory of one session and of all")
    measured.add_argument("folder", type=Path)
    measured.add_argument("--vehicle", type=Path, default=bundled("stonefish") / "vehicle.toml")
    measured.add_argument("--rounds", type=int, default=3)
    measured.set_defaults(action=lambda chosen: memory(chosen.folder, chosen.vehicle, chosen.rounds))
    timing = commands.add_parser("speed", help="one node of a cluster, and two")
    timing.add_argument("folder", type=Path)
    timing.add_argument("--vehicle", type=Path, default=bundled("stonefish") / "vehicle.toml")
    timing.add_argument("--rounds", type=int, default=3)
    timing.set_defaults(action=lambda chosen: speed(chosen.folder, chosen.vehicle, chosen.rounds))
    return top


if __name__ == "__main__":
    chosen = parser().parse_args()
    chosen.action(chosen)
