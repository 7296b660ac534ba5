"""The covariance of estimated numbers, in a file of its own beside the vehicle file or diagnosis with them.

`vehicle.toml` has `vehicle.covariance.parquet` beside it.  A vehicle file may be edited since: a covariance
of other values than the file's is not used, and that is said.
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
    """Where the covariance of a vehicle file, or of a diagnosis, is."""
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
    """Write a covariance beside a vehicle file or a diagnosis; none of no numbers, nor beside a device.

    Args:
        estimates: The numbers as the file has them.
        path: The file that it is for.
        stage: The command.
        inputs: What the numbers were estimated from.
        vehicle_text: Text of the vehicle file.
        parameters: What else its footer says.
    """
    if not (estimates.entries and Path(path).is_file()):
        return
    frame = estimates.frame()
    made = table.make(
        KIND, frame, stage=stage, parameters=parameters, inputs=inputs, vehicle_text=vehicle_text
    )
    table.write(made, beside(path))


def read(path: str | Path, vehicle: Vehicle | None = None) -> tuple[Estimates | None, str]:
    """The covariance beside a vehicle file or a diagnosis.

    Args:
        path: The file that it is for.
        vehicle: What the file says, to hold the values against.

    Returns:
        The estimates, None where there is no such file or it is of other values; and then what to say of it.

    Raises:
        DataError: There is such a file, but it is broken.
    """
    place = beside(path)
    if not place.exists():
        return None, ""
    estimates = of(table.read(place, KIND), str(place))
    other = estimates.disagreement(vehicle) if vehicle is not None else ""
    return (None, f"{place}: {other}; it is ignored") if other else (estimates, "")


def of(artefact: Artefact, name: str = KIND) -> Estimates:
    """The estimates of a covariance table.

    Raises:
        DataError: The rows are of different lengths, or no covariance has such correlations.
    """
    lengths = artefact.frame["correlation"].list.len().to_list()
    if lengths != [artefact.frame.height] * artefact.frame.height:
        raise DataError(f"{name}: correlation must have a number for each of the rows: write it again")
    found = Estimates.of(artefact.frame)
    if not np.allclose(found.covariance, found.covariance.T, rtol=1e-6):
        raise DataError(f"{name}: correlation must be symmetric: write it again")
    return found


def with_errors(vehicle: Vehicle, estimates: Estimates) -> Vehicle:
    """The vehicle with the standard errors of estimates in its tables, where these state none."""
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
