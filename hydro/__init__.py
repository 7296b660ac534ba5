"""hydro: find the missing physics of an underwater vehicle, and fly it fast and true in MuJoCo.

The functions here are the whole line on polars frames; the command line offers the same on files. Importing
`hydro` loads nothing heavy: the first call of a function loads what it needs.

    raw = hydro.read("raw.parquet")
    vehicle = hydro.vehicle("vehicle.toml")
    split, blocks = hydro.split(hydro.labels(raw, vehicle))
    model = hydro.train(split, model="physfeat")
    series, metrics = hydro.replay(raw, vehicle, models=[model])
"""

from __future__ import annotations

from hydro.api import (
    evaluate,
    features,
    labels,
    read,
    read_model,
    replay,
    simulate,
    split,
    train,
    vehicle,
    write,
    write_model,
)

__all__ = [
    "evaluate",
    "features",
    "labels",
    "read",
    "read_model",
    "replay",
    "simulate",
    "split",
    "train",
    "vehicle",
    "write",
    "write_model",
]
