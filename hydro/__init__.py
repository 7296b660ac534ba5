"""hydro: find the missing physics of an underwater vehicle, and fly it fast and true in MuJoCo.

The functions here are the whole line on polars frames; the command line offers the same on files. Importing
`hydro` loads nothing heavy: the first call of a function loads what it needs.

    raw = hydro.read("raw.parquet")
    vehicle = hydro.vehicle("vehicle.toml")
    split, blocks = hydro.split(hydro.labels(raw, vehicle))
    model = hydro.train(split, model="physfeat")
    series, metrics = hydro.replay(raw, vehicle, models=[model])

And what is missing in a vehicle file:

    for step in hydro.explain(raw, vehicle, holdout=hydro.read("heldout.parquet")):
        print(step.number, step.added, step.error("holdout"))
"""

from __future__ import annotations

from hydro.api import (
    add,
    compare,
    diagnose,
    evaluate,
    explain,
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
    "add",
    "compare",
    "diagnose",
    "evaluate",
    "explain",
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
