"""Covariance of estimated values, in a separate file next to their vehicle file or diagnosis.

The covariance of `vehicle.toml` is in `vehicle.covariance.parquet`.  The vehicle file may have been edited
since.  A covariance of other values than those of the file is ignored, with a warning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hydro.core.errors import DataError
from hydro.core.simulation.estimates import Estimates
from hydro.core.vehicle.description import Vehicle
from hydro.io import table
from hydro.io.table import Artefact

KIND = "covariance"


def beside(path: str | Path) -> Path:
    """Return the path at which the covariance of a vehicle file or diagnosis is stored, next to the file.

    It is `vehicle.covariance.parquet` for `vehicle.toml`; it may not exist.
    """
    return Path(path).with_name(f"{Path(path).stem}.{KIND}.parquet")


def write(
    estimates: Estimates,
    path: str | Path,
    *,
    stage: str,
    inputs: Sequence[Artefact],
    vehicle_text: str,
    parameters: Mapping[str, Any] | None = None,
) -> None:
    """Write a covariance next to a vehicle file or diagnosis.

    Nothing is written if there are no values, or if the file is no regular file, such as /dev/stdout.

    Args:
        estimates: Estimated values, equal to those in the file.
        path: Path of the vehicle file or diagnosis.
        stage: Name of the command that made the estimates.
        inputs: Artefacts from which the values were estimated.
        vehicle_text: Text of the vehicle file.
        parameters: Further parameters in the footer of the table.
    """
    if not (estimates.entries and Path(path).is_file()):
        return
    frame = estimates.frame()
    made = table.make(
        KIND, frame, stage=stage, parameters=parameters, inputs=inputs, vehicle_text=vehicle_text
    )
    table.write(made, beside(path))


def read(path: str | Path, vehicle: Vehicle | None = None) -> tuple[Estimates | None, str]:
    """Read the covariance that is stored next to a vehicle file or diagnosis.

    Args:
        path: The vehicle file or diagnosis.
        vehicle: Vehicle of the file, whose values the covariance must match; None for no check.

    Returns:
        Estimates, or None if there is no covariance or it belongs to other values; and a warning, or an empty
        text.

    Raises:
        DataError: The covariance file is damaged.
    """
    place = beside(path)
    if not place.exists():
        return None, ""
    estimates = of(table.read(place, KIND), str(place))
    other = estimates.disagreement(vehicle) if vehicle is not None else ""
    return (None, f"{place}: {other}; it is ignored") if other else (estimates, "")


def of(artefact: Artefact, name: str = KIND) -> Estimates:
    """Return the estimated values and their covariance that a covariance table contains.

    Args:
        artefact: The table.
        name: Name of its file in error messages.

    Raises:
        DataError: The rows have different lengths, or the correlations are not symmetric.
    """
    lengths = artefact.frame["correlation"].list.len().to_list()
    if lengths != [artefact.frame.height] * artefact.frame.height:
        raise DataError(f"{name}: correlation must have a number for each of the rows: write it again")
    found = Estimates.of(artefact.frame)
    if not np.allclose(found.covariance, found.covariance.T, rtol=1e-6):
        raise DataError(f"{name}: correlation must be symmetric: write it again")
    return found


def with_errors(vehicle: Vehicle, estimates: Estimates) -> Vehicle:
    """Return a copy of the vehicle whose effect tables state standard errors, taken from estimates.

    Tables that state standard errors already keep them.

    Args:
        vehicle: The vehicle.
        estimates: Estimated values with their covariance.
    """
    stated = {table["name"] for table in vehicle.effect if "standard_error" in table}
    errors: dict[str, dict[str, object]] = {}
    for entry, error in zip(estimates.entries, estimates.errors, strict=True):
        given = np.asarray(next(iter(vehicle.effects(entry.effect)))[entry.parameter], float)
        held = errors.setdefault(entry.effect, {}).setdefault(entry.parameter, np.zeros(given.shape))
        assert isinstance(held, np.ndarray)
        held[entry.index] = error
    tables = (
        one
        | {"standard_error": {key: np.asarray(value).tolist() for key, value in errors[one["name"]].items()}}
        if one["name"] in errors and one["name"] not in stated
        else one
        for one in vehicle.effect
    )
    return msgspec.structs.replace(vehicle, effect=tuple(tables))
