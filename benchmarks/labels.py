"""Cost of `hydro labels`, compared with plain pyarrow and with a `filterpy` loop, in one run.

Run: `python benchmarks/labels.py RAW.parquet --vehicle VEHICLE.toml`

Every round measures one after the other, so that a busy machine disturbs both equally:

* pyarrow: read the raw table, and write the labels table (large columns float32) with its default options
  (snappy, dictionaries), and once more with zstd;
* hydro: the whole command without the interpreter's start: read, check, compute, check, hash, write, sync.

Medians over the rounds are compared.  Peak memory is that of a process that runs the command once.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq

from hydro import cli

WRITES = (("snappy", "its defaults"), ("zstd", "zstd"))
"""Compressions of pyarrow, and their names."""
LOOPED = 20_000
"""Rows that go through the filterpy loop; its time grows with the rows."""
MEASURE_PEAK = "import resource, sys; from hydro import cli; code = cli.main(sys.argv[1:]); \
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss); sys.exit(code)"


def seconds(call: Callable[[], object]) -> float:
    """Return the wall time of one call [s]."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def label(raw: str, vehicle: str, destination: Path) -> None:
    """Run `hydro labels` in this process."""
    if code := cli.main(["labels", raw, "--vehicle", vehicle, "-o", str(destination)]):
        sys.exit(code)


def peak(raw: str, vehicle: str, destination: Path) -> float:
    """Return the peak resident memory [GB] of a process that runs the command once."""
    line = [sys.executable, "-c", MEASURE_PEAK, "labels", raw, "--vehicle", vehicle, "-o", str(destination)]
    done = subprocess.run(line, check=True, stdout=subprocess.PIPE, text=True)
    return int(done.stdout) * (1 if sys.platform == "darwin" else 1024) / 1e9


def narrow(table: pa.Table) -> pa.Table:
    """Return the table with float32 in place of float64, except for the time."""
    fields = [
        field.with_type(pa.float32()) if field.type == pa.float64() and field.name != "t" else field
        for field in table.schema
    ]
    return table.cast(pa.schema(fields))


def filterpy_loop(raw: pl.DataFrame) -> None:
    """Smooth the six velocities of each session in a plain loop with filterpy."""
    from filterpy.common import Q_continuous_white_noise
    from filterpy.kalman import KalmanFilter

    for name in ("u", "v", "w", "p", "q", "r"):
        axis = KalmanFilter(dim_x=2, dim_z=1)
        axis.F, axis.H = np.array([[1.0, 0.02], [0.0, 1.0]]), np.array([[1.0, 0.0]])
        axis.R, axis.Q = np.eye(1) * 1e-4, Q_continuous_white_noise(dim=2, dt=0.02, spectral_density=1.0)
        means, covariances, _, _ = axis.batch_filter(raw[name].to_numpy())
        axis.rts_smoother(means, covariances)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("raw", help="raw table")
    parser.add_argument("--vehicle", required=True, help="vehicle file")
    parser.add_argument("--rounds", type=int, default=7)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        labels, copy = Path(folder, "labels.parquet"), Path(folder, "copy.parquet")
        label(given.raw, given.vehicle, labels)  # compiles the kernels, and fills the disk's cache
        made = narrow(pq.read_table(labels))
        print(f"{made.num_rows:,} rows, labels {made.num_columns} columns; medians of {given.rounds} rounds")
        reads, ours = [], []
        writes: dict[str, list[float]] = {name: [] for name, _ in WRITES}
        for _ in range(given.rounds):
            reads.append(seconds(lambda: pq.read_table(given.raw)))
            for name, spent in writes.items():
                spent.append(seconds(lambda name=name: pq.write_table(made, copy, compression=name)))
            ours.append(seconds(lambda: label(given.raw, given.vehicle, labels)))
        read, whole = float(np.median(reads)), float(np.median(ours))
        print(f"{'pyarrow reads the raw table':48} {read:7.3f} s")
        for name, words in WRITES:
            print(f"{f'pyarrow writes the labels table, {words}':48} {np.median(writes[name]):7.3f} s")
        print(f"{'hydro labels, whole':48} {whole:7.3f} s")
        for name, words in WRITES:
            plain = np.array(reads) + writes[name]
            low, high = np.percentile(np.array(ours) / plain, (0, 100))
            ratio = whole / float(np.median(plain))
            print(f"hydro / pyarrow ({words}): {ratio:.2f} (rounds {low:.2f} to {high:.2f}; at most 4)")
        print(f"peak memory of hydro labels: {peak(given.raw, given.vehicle, labels):.2f} GB (below 2)")
    part = pl.read_parquet(given.raw, n_rows=LOOPED)
    loop = seconds(lambda: filterpy_loop(part)) * made.num_rows / part.height
    print(f"filterpy loop, smoothing alone: {loop:.0f} s, by {part.height:,} rows of them", end="; ")
    print(f"{loop / whole:.0f} times hydro labels")


if __name__ == "__main__":
    main()
