"""Effects of a changed vehicle file that act in addition to a residual network trained with another file.

A network whose labels exclude only added mass predicts all water forces on the hull.  These include the
effects of the vehicle file of its labels.  A payload or an external force that is new since then adds to the
prediction; a changed hull does not.  A current adds to a network that learnt in still water: its frame moves
with the current (`bridge.water.residual`).  A network that learnt in a current is valid only in that current.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hydro.core.effects import CATALOGUE
from hydro.core.effects.record import BOOKKEEPING
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle

Table = Mapping[str, Any]

POSE_FAMILIES = frozenset({"restoring", "surroundings"})
"""Families whose wrenches depend only on the pose, so that they add to the network's wrench."""
INDEPENDENT_KINDS = frozenset({"actuator", "sensor"})
"""Kinds that are not water forces: they come from the vehicle file with any network."""


def beside(vehicle: Vehicle, labelled: Vehicle | None) -> tuple[Table, ...]:
    """Return the `[[effect]]` tables that must act in addition to a residual network.

    The labels of the network exclude added mass only.

    Args:
        vehicle: Vehicle that is simulated.
        labelled: Vehicle of the network's labels.  If it is unknown (None), all effects of `vehicle` that
            cannot be added to a network are assumed to be in the labels.

    Returns:
        The tables of those effects of `vehicle` that the labels do not contain; () if there are none.

    Raises:
        DataError: The files differ in effects that cannot be added to the network.
    """
    now = [effect for effect in vehicle.effect if CATALOGUE[effect["name"]].kind not in INDEPENDENT_KINDS]
    if labelled is None:
        return tuple(effect for effect in now if _depends_on_pose(effect))
    then = [effect for effect in labelled.effect if CATALOGUE[effect["name"]].kind not in INDEPENDENT_KINDS]
    before, after = [_values(effect) for effect in then], [_values(effect) for effect in now]
    new = [effect for effect in now if _values(effect) not in before]
    gone = [effect for effect in then if _values(effect) not in after]
    still = not any(CATALOGUE[effect["name"]].kind == "flow" for effect in then)
    refused = [effect["name"] for effect in gone]
    refused += [
        effect["name"]
        for effect in new
        if not (_depends_on_pose(effect) or (still and _is_uniform_current(effect)))
    ]
    if refused:
        raise DataError(
            f"{', '.join(dict.fromkeys(refused))} of {vehicle.name}: not as in the vehicle file that the "
            "network's labels were made with, and cannot be added to it; replay with that file, or train on "
            "labels of this one (`hydro labels --subtract effects`)"
        )
    return tuple(new)


def _depends_on_pose(effect: Table) -> bool:
    """Return whether an effect's wrench depends only on the pose, so that it adds to that of the network."""
    record = CATALOGUE[effect["name"]]
    return record.family in POSE_FAMILIES and record.kind == "wrench"


def _is_uniform_current(effect: Table) -> bool:
    """Return whether an effect is a uniform current without a wrench of its own."""
    record = CATALOGUE[effect["name"]]
    return record.kind == "flow" and record.kernel is None


def _values(effect: Table) -> dict[str, Any]:
    """Return the table of an effect without the entries that a fit adds, such as standard errors."""
    return {key: value for key, value in effect.items() if key not in BOOKKEEPING or key == "name"}
