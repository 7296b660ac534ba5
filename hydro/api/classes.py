"""Classes that the functions of `hydro` return or raise; heavy ones are loaded when they are used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hydro.api.comparison import Comparison
from hydro.api.diagnosis import Diagnosis
from hydro.api.fitted import Fit
from hydro.api.history import History
from hydro.api.study import Step, Study
from hydro.core.errors import DataError, HydroError, HydroWarning, UsageError

if TYPE_CHECKING:
    from hydro.core.diagnosis.findings import Prediction, Status
    from hydro.core.logs.logmap import LogMap
    from hydro.core.simulation.estimates import Estimates
    from hydro.core.vehicle.description import Vehicle
    from hydro.io.log_import import ImportReport
    from hydro.io.model import Model
    from hydro.learn.train import Epoch
    from hydro.sim.gpu.plant import GpuPlant

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
]

LOADED_LATE = {
    "Epoch": "hydro.learn.train",
    "Estimates": "hydro.core.simulation.estimates",
    "GpuPlant": "hydro.sim.gpu.plant",
    "ImportReport": "hydro.io.log_import",
    "LogMap": "hydro.core.logs.logmap",
    "Model": "hydro.io.model",
    "Prediction": "hydro.core.diagnosis.findings",
    "Status": "hydro.core.diagnosis.findings",
    "Vehicle": "hydro.core.vehicle.description",
}
"""Module of each class that is imported only when it is first used, by class name."""


def __getattr__(name: str) -> Any:
    """Return a class of LOADED_LATE."""
    if name in LOADED_LATE:
        return getattr(import_module(LOADED_LATE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
