"""Cost of checks and hashes compared with plain pyarrow, for a labels table of 857,542 rows and 54 columns.

Run: `python benchmarks/tables.py [RAW.parquet]`; without a recording the numbers are random.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pyarrow.parquet as pq

from hydro.io import provenance, schema, table

ROWS, TIMES = 857_542, 3


def seconds(what: str, call: Callable[[], object]) -> float:
    spent = []
    for _ in range(TIMES):
        start = time.perf_counter()
        call()
        spent.append(time.perf_counter() - start)
    print(f"{what:45s} {min(spent):6.3f} s")
    return min(spent)


def recording() -> pl.DataFrame:
    columns = schema.load("raw").columns([f"cmd_{i + 1}" for i in range(8)])
    rng = np.random.default_rng(1)
    values = {name: rng.uniform(-1, 1, ROWS).astype(np.float32) for name in columns}
    return pl.DataFrame(values | {"session": np.repeat("only", ROWS), "t": np.arange(ROWS) * 0.02})


def main() -> None:
    rng = np.random.default_rng(2)
    with tempfile.TemporaryDirectory() as folder:
        raw_path, labels_path = Path(folder, "raw.parquet"), Path(folder, "labels.parquet")
        raw = table.read(sys.argv[1], "raw").frame if len(sys.argv) > 1 else recording()
        table.write(table.make("raw", raw, stage="import"), raw_path)
        names = schema.load("labels").columns(raw.columns)
        derived = (name for name in names if name not in raw.columns)
        labels = raw.with_columns(
            pl.Series(name, np.cumsum(rng.standard_normal(raw.height)).astype(np.float32)) for name in derived
        )
        arrow = labels.to_arrow(compat_level=pl.CompatLevel.oldest())
        print(f"{raw.height:,} rows; raw {raw.width}, labels {labels.width} columns; best of {TIMES}")
        plain_read = seconds("pyarrow reads raw", lambda: pq.read_table(raw_path))
        plain_write = seconds(
            "pyarrow writes labels, its defaults and zstd",
            lambda: pq.write_table(arrow, labels_path, compression="zstd"),
        )
        options = {"compression": "zstd", "compression_level": 1, "use_dictionary": ["session"]}
        like_write = seconds(
            "pyarrow writes labels, hydro's options", lambda: pq.write_table(arrow, labels_path, **options)
        )
        seconds("check of labels", lambda: schema.load("labels").check(labels, "labels"))
        seconds("content hash of labels", lambda: provenance.content_hash(labels))
        made = table.make("labels", labels, stage="labels")
        read = seconds("hydro reads raw (checked, hash compared)", lambda: table.read(raw_path))
        make = seconds("hydro checks and hashes labels", lambda: table.make("labels", labels, stage="x"))
        write = seconds("hydro writes labels (checked, synced)", lambda: table.write(made, labels_path))
        ours = read + make + write
        print(
            f"checks and hash of labels / write by pyarrow: {make / plain_write:.2f}, {make / like_write:.2f}"
        )
        print(f"hydro / pyarrow, read and write: {ours / (plain_read + plain_write):.2f}", end=", ")
        print(f"{ours / (plain_read + like_write):.2f} (its defaults, hydro's options)")


if __name__ == "__main__":
    main()
