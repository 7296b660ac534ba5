"""Hull-force model of a file that is far from its vehicle: the file is fitted to the recording first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import msgspec
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

BUILT_IN = ("buoyancy_offset", "net_buoyancy", "thruster_lag")
"""Effects that become values of buoyancy and thrusters, so that a later change of them is an effect anew."""
LACKING = ("added_mass_coupling", "coupled_damping", "thruster_inflow", *BUILT_IN)
"""Effects that files of real vehicles often lack.  None of them has several local minima, and together with
mass and damping one recording determines them."""
FITTED = ("inertia", "damping")
"""Families of the file's effects that are fitted."""


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
        if CATALOGUE[str(table["name"])].family in FITTED and not wholly_known(vehicle, str(table["name"]))
    ]
    further = [name for name in LACKING if not vehicle.names(name)]
    try:
        shots = stable_shots(vehicle, log).some(SHOTS)
        model, _, reached = weighed_fit(vehicle, [*own, *further], shots, log)
        whole = with_built_in(model.vehicle, [name for name in BUILT_IN if name in further])
        other = learnt(whole, stable_shots(whole, log))
    except (DataError, np.linalg.LinAlgError):
        return hull
    if not reached or not other.left < hull.left:
        return hull
    return replace(other, given=hull.given, alone=hull.alone, completion=Completion(vehicle, whole))


def with_built_in(vehicle: Vehicle, effects: Sequence[str]) -> Vehicle:
    """Return a vehicle whose effects of BUILT_IN are values of its buoyancy and thrusters.

    Args:
        vehicle: Vehicle with the effects.
        effects: Names of those effects that become values.
    """
    values = {name: vehicle.effects(name)[0] for name in effects}
    offset, more, later = (values.get(name, {}) for name in BUILT_IN)
    old = vehicle.buoyancy
    force = old.force + more.get("dB", 0.0)
    moved = np.array([offset.get(axis, 0.0) for axis in ("dx", "dy", "dz")]) * old.force / force
    buoyancy = msgspec.structs.replace(
        old, force=force, center=tuple((np.array(old.center) + moved).tolist())
    )
    thrusters = tuple(
        msgspec.structs.replace(one, time_constant=max(one.time_constant + later.get("dT", 0.0), 0.0))
        for one in vehicle.thruster
    )
    kept = tuple(table for table in vehicle.effect if table["name"] not in effects)
    return msgspec.structs.replace(vehicle, buoyancy=buoyancy, thruster=thrusters, effect=kept)
