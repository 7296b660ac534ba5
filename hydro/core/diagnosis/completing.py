"""Hull-force model of a file that is far from its vehicle: the file is fitted to the recording first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro.core.diagnosis.baseline import stable_shots, weighed_fit
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import passive
from hydro.core.diagnosis.settings import SHOTS
from hydro.core.effects import CATALOGUE
from hydro.core.effects.built_in import BUILT_IN, LACKING, with_built_in
from hydro.core.effects.catalogue import entries, wholly_known
from hydro.core.errors import DataError
from hydro.core.residual.completion import Completion
from hydro.core.residual.hull import Hull, learnt
from hydro.core.vehicle.description import Vehicle

FITTED = ("inertia", "damping")
"""Families of the file's effects that are fitted."""
FINS = (*FITTED, "hull")
"""Families that are fitted where FITTED is not enough: fins hold a torpedo on its course."""


def completed(vehicle: Vehicle, log: Preprocessed, hull: Hull) -> Hull:
    """Return the hull-force model learnt about the fitted vehicle, or `hull` if that one predicts better.

    The fins of the file are fitted only where the model about the vehicle with its own fins is not better.

    Args:
        vehicle: Vehicle file.
        log: Recording from which the model is learnt.
        hull: Model learnt about the file as given.
    """
    first, second = (_fitted(vehicle, families) for families in (FITTED, FINS))
    found = _completed(vehicle, log, hull, first)
    return _completed(vehicle, log, hull, second) if found is hull and second != first else found


def _fitted(vehicle: Vehicle, families: Sequence[str]) -> list[str]:
    """Return the names of the file's effects of some families whose values are not all known."""
    names = [str(table["name"]) for table in vehicle.effect]
    return [name for name in names if CATALOGUE[name].family in families and not wholly_known(vehicle, name)]


def _completed(vehicle: Vehicle, log: Preprocessed, hull: Hull, own: Sequence[str]) -> Hull:
    """Return the model learnt about the vehicle with effects `own` of the file fitted, or `hull`."""
    further = [name for name in LACKING if not vehicle.names(name)]
    try:
        shots = stable_shots(vehicle, log).some(SHOTS)
        model, _, reached = weighed_fit(vehicle, [*own, *further], shots, log)
        whole = with_built_in(passive(model).vehicle, [name for name in BUILT_IN if name in further])
        entries(whole)  # values that a vehicle file accepts
        other = learnt(whole, stable_shots(whole, log))
    except (DataError, np.linalg.LinAlgError):
        return hull
    if not reached or not other.left < hull.left:
        return hull
    return replace(other, given=hull.given, alone=hull.alone, completion=Completion(vehicle, whole))
