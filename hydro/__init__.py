"""hydro: find the missing physics of an underwater vehicle, and simulate it fast and accurately in MuJoCo.

The functions here are the whole line on polars frames; the command line offers the same on files. Importing
`hydro` loads nothing heavy: the first call of a function loads what it needs.

    raw = hydro.read("raw.parquet")
    vehicle = hydro.vehicle("vehicle.toml")
    split, blocks = hydro.split(hydro.labels(vehicle, raw))
    model = hydro.train(split, model="physfeat")
    series, metrics = hydro.replay(vehicle, raw, models=[model])

And what is missing in a vehicle file:

    for step in hydro.explain(vehicle, raw, holdout=hydro.read("heldout.parquet")):
        print(step.number, step.added, step.error("holdout"))

And the vehicle in MuJoCo, to step or to view:

    model, data = hydro.student(vehicle)
"""

from __future__ import annotations

from typing import Any

from hydro import _moved
from hydro.api.files import import_log, read, read_model, vehicle, write, write_model, write_vehicle
from hydro.api.networks import evaluate, features, labels, replay, split, train
from hydro.api.physics import add, compare, diagnose, explain, fit, simulate
from hydro.api.students import load_student, student

__all__ = [
    "add",
    "compare",
    "diagnose",
    "evaluate",
    "explain",
    "features",
    "fit",
    "import_log",
    "labels",
    "load_student",
    "read",
    "read_model",
    "replay",
    "simulate",
    "split",
    "student",
    "train",
    "vehicle",
    "write",
    "write_model",
    "write_vehicle",
]

_moved.install()


def __getattr__(name: str) -> Any:
    """`hydro.__version__`, read from the installed distribution when it is asked for."""
    if name == "__version__":
        from importlib.metadata import version

        return version("deep-hydro-sim")
    raise AttributeError(f"module 'hydro' has no attribute {name!r}")
