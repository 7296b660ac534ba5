"""Which effects of a changed vehicle file act beside a residual network that learnt from another.

A network of what added mass alone leaves holds all forces of the water on the hull, those of the file its
labels were made with among them.  What is hung on the vehicle or holds it from outside since then adds to
that; another hull does not.  A current in which a network of still water is flown moves the frame that the
network holds in (`bridge.water.residual`); a network that learnt in a current holds in that one alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hydro.core.effects import CATALOGUE
from hydro.core.effects.record import BOOKKEEPING
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle

Table = Mapping[str, Any]

ADDED = frozenset({"restoring", "surroundings"})
"""Families whose wrenches depend on the pose alone, so that they add to a network's."""
ANYWAY = frozenset({"actuator", "sensor"})
"""Kinds that are none of the water's forces: they are the file's with any network."""


def beside(vehicle: Vehicle, labelled: Vehicle | None) -> tuple[Table, ...]:
    """The `[[effect]]` tables that act beside a network of what added mass alone leaves; a current may.

    Args:
        vehicle: The vehicle that is flown.
        labelled: The one that the network's labels were made with; None where nobody knows, and it is taken
            for one whose effects are all those of this file that no network can be flown beside.

    Raises:
        DataError: Effects differ that the network cannot be flown beside.
    """
    now = [effect for effect in vehicle.effect if CATALOGUE[effect["name"]].kind not in ANYWAY]
    if labelled is None:
        return tuple(effect for effect in now if _adds(effect))
    then = [effect for effect in labelled.effect if CATALOGUE[effect["name"]].kind not in ANYWAY]
    before, after = [_values(effect) for effect in then], [_values(effect) for effect in now]
    new = [effect for effect in now if _values(effect) not in before]
    gone = [effect for effect in then if _values(effect) not in after]
    still = not any(CATALOGUE[effect["name"]].kind == "flow" for effect in then)
    refused = [effect["name"] for effect in gone]
    refused += [effect["name"] for effect in new if not (_adds(effect) or (still and _drifts(effect)))]
    if refused:
        raise DataError(
            f"{', '.join(dict.fromkeys(refused))} of {vehicle.name}: not as in the vehicle file that the "
            "network's labels were made with, and cannot act beside it; replay with that file, or train on "
            "labels of this one (`hydro labels --subtract effects`)"
        )
    return tuple(new)


def _adds(effect: Table) -> bool:
    """Whether an effect's wrench adds to a network's: it depends on the pose alone."""
    record = CATALOGUE[effect["name"]]
    return record.family in ADDED and record.kind == "wrench"


def _drifts(effect: Table) -> bool:
    """Whether an effect moves the water alike everywhere: where one has a wrench of its own, it does not."""
    record = CATALOGUE[effect["name"]]
    return record.kind == "flow" and record.kernel is None


def _values(effect: Table) -> dict[str, Any]:
    """An effect without what a fit notes beside it."""
    return {key: value for key, value in effect.items() if key not in BOOKKEEPING or key == "name"}
