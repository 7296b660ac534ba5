"""hydro: diagnose missing physics in underwater vehicle models, and simulate the vehicles in MuJoCo.

The functions work on polars data frames and vehicles; the command line does the same with files. Importing
`hydro` is fast, because each function loads its libraries at its first call.

    # Read a recording and a vehicle file:
    raw = hydro.read("raw.parquet")
    vehicle = hydro.vehicle("vehicle.toml")

    # Train a network on the recording:
    split, blocks = hydro.split(hydro.labels(vehicle, raw))
    model = hydro.train(split, model="physfeat")

    # Replay the recorded commands with it:
    series, metrics = hydro.replay(vehicle, raw, models=[model])

    # Find missing effects of a vehicle file:
    found = hydro.diagnose(vehicle, raw)
    print(found.headline)

    # Add them step by step:
    study = hydro.explain(vehicle, raw, holdout=hydro.read("heldout.parquet"))
    better = study.vehicle

    # Step or view the vehicle in MuJoCo:
    model, data = hydro.student(vehicle)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hydro import _moved
from hydro.api import classes as _classes
from hydro.api.classes import (
    Comparison,
    DataError,
    Diagnosis,
    Fit,
    History,
    HydroError,
    HydroWarning,
    Step,
    Study,
    UsageError,
)
from hydro.api.files import import_log, read, read_model, vehicle, write, write_model, write_vehicle
from hydro.api.history import track
from hydro.api.networks import evaluate, features, labels, replay, split, train
from hydro.api.physics import add, compare, diagnose, explain, fit, simulate
from hydro.api.students import load_student, student

if TYPE_CHECKING:
    from hydro.api.classes import (
        Epoch,
        Estimates,
        GpuPlant,
        ImportReport,
        LogMap,
        Model,
        Prediction,
        Status,
        Vehicle,
    )

__all__ = [
    "Comparison",
    "DataError",
    "Diagnosis",
    "Epoch",
    "Estimates",
    "Fit",
    "GpuPlant",
    "History",
    "HydroError",
    "HydroWarning",
    "ImportReport",
    "LogMap",
    "Model",
    "Prediction",
    "Status",
    "Step",
    "Study",
    "UsageError",
    "Vehicle",
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
    "track",
    "train",
    "vehicle",
    "write",
    "write_model",
    "write_vehicle",
]

_moved.install()


def __getattr__(name: str) -> Any:
    """Return the installed version as `hydro.__version__`, or a class that is loaded on first use."""
    if name == "__version__":
        from importlib.metadata import version

        return version("deep-hydro-sim")
    if name in _classes.LOADED_LATE:
        return getattr(_classes, name)
    raise AttributeError(f"module 'hydro' has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return all public names, including those that are loaded on first use."""
    return sorted({*globals(), *__all__})
