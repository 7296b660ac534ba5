"""Effects that files of real vehicles often lack, and those that belong into the file's own values."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from hydro.core.vehicle.description import Vehicle

BUILT_IN = ("buoyancy_offset", "net_buoyancy", "thruster_lag")
"""Effects that become values of buoyancy and thrusters, so that a later change of them is an effect anew."""
LACKING = ("added_mass_coupling", "coupled_damping", "thruster_inflow", *BUILT_IN)
"""Effects that files of real vehicles often lack.  None of them has several local minima, and together with
mass and damping one recording determines them."""


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
        if one.pushes
        else one  # a command without thrust, such as that of a rudder, has no lag
        for one in vehicle.thruster
    )
    kept = tuple(table for table in vehicle.effect if table["name"] not in effects)
    return msgspec.structs.replace(vehicle, buoyancy=buoyancy, thruster=thrusters, effect=kept)
