"""Hull-force model of a file that is far from its vehicle: the file is fitted to the recording first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro.core.diagnosis.baseline import stable_shots, weighed_fit
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.settings import SHOTS
from hydro.core.effects import CATALOGUE
from hydro.core.effects.catalogue import wholly_known
from hydro.core.errors import DataError
from hydro.core.residual.completion import Completion
from hydro.core.residual.hull import Hull, learnt
from hydro.core.vehicle.description import Vehicle

LACKING = (
    "added_mass_coupling",
    "coupled_damping",
    "buoyancy_offset",
    "net_buoyancy",
    "thruster_lag",
    "thruster_inflow",
    "thruster_asymmetry",
)
"""Effects that most files of a real vehicle lack.  None of them has several local minima, and together with
mass and damping one recording determines them."""


def completed(vehicle: Vehicle, log: Preprocessed, hull: Hull) -> Hull:
    """Return the hull-force model learnt about the fitted vehicle, or `hull` if that one predicts better.

    Args:
        vehicle: Vehicle file.
        log: Recording from which the model is learnt.
        hull: Model learnt about the file as given.
    """
    own = [
        str(table["name"])
        for table in vehicle.effect
        if not CATALOGUE[str(table["name"])].is_random and not wholly_known(vehicle, str(table["name"]))
    ]
    further = [name for name in LACKING if not vehicle.names(name)]
    try:
        shots = stable_shots(vehicle, log).some(SHOTS)
        model, _, reached = weighed_fit(vehicle, [*own, *further], shots, log)
        other = learnt(model.vehicle, stable_shots(model.vehicle, log))
    except (DataError, np.linalg.LinAlgError):
        return hull
    if not reached or not other.left < hull.left:
        return hull
    return replace(other, given=hull.given, alone=hull.alone, completion=Completion(vehicle, model.vehicle))
