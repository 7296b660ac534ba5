"""Plain sentence for the values of any effect of the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hydro.core.effects.case import Case
from hydro.core.effects.catalogue import CATALOGUE
from hydro.core.effects.phrases import Entry, stated
from hydro.core.effects.record import Effect, Parameter
from hydro.core.effects.wording import AXES, without_uncertainty
from hydro.core.vehicle.description import Vehicle


def sentence(
    vehicle: Vehicle,
    effect_name: str,
    values: Mapping[str, Any],
    errors: Mapping[str, Any],
    dt: float,
    *,
    brief: bool = False,
    earlier: bool = False,
) -> str:
    """Return one or two plain sentences that state the values of an effect.

    If the vehicle has the effect, the sentence compares it with the file; else it states what is missing.

    Args:
        vehicle: The vehicle file as given.
        effect_name: Name in the catalogue, with its label if it has one.
        values: The effect's table, in the units of the catalogue.
        errors: Standard errors in the shape of `values`; they may be missing, NaN, or 0 for held values.
        dt: Sample time of the log [s].
        brief: Whether to leave out standard errors, the file's values and all but the most significant
            component.
        earlier: Whether the vehicle was fitted to an earlier recording, so that its values are named as
            earlier ones.

    Returns:
        The text, with its full stop.

    Raises:
        KeyError: The catalogue has no such effect.
    """
    effect = CATALOGUE[effect_name]
    before = next((table for table in vehicle.effect if table.get("name") == effect_name), None)
    given = {key: value for key, value in values.items() if value is not None}
    case = Case(vehicle, effect_name, given, errors, dt, before, brief, earlier)
    told = generic(effect, case) if effect.sentence is None else effect.sentence(case)
    return without_uncertainty(told) if brief else told


def generic(effect: Effect, case: Case) -> str:
    """Return a sentence on an effect without a sentence function, from its parameters' meanings."""
    noun = effect.name.replace("_", " ")
    given = [one for one in effect.parameters if one.name in case.values or one.name not in effect.one_of]
    by_axis = len(given) == 1 and given[0].shape == (6,)
    entries = [entry for one in given for entry in entries_of(one, case, noun if by_axis else "")]
    return stated(case, noun, entries)


def entries_of(parameter: Parameter, case: Case, noun: str) -> list[Entry]:
    """Return the components of one parameter, each with the words that describe it.

    Args:
        parameter: The parameter.
        case: Values of the effect.
        noun: Noun for all components, followed by the axis of each; empty for the parameter's meaning.
    """
    given = case.values.get(parameter.name, (case.before or {}).get(parameter.name))
    shape = np.shape(given) if given is not None else tuple(n for n in parameter.shape if isinstance(n, int))
    if len(shape) != len(parameter.shape):
        shape = ()
    entries = []
    for index, one in zip(np.ndindex(*shape), case.many(parameter.name, shape), strict=True):
        where = place_of(index, shape)
        label, part = f"{parameter.meaning}{where}", f"as {parameter.meaning}{where}"
        if noun and index:
            label, part = f"{noun}{where}", where.strip()
        entries.append(Entry(label, part, one, parameter.unit_at(index) if shape else parameter.unit[0]))
    return entries


def place_of(index: tuple[int, ...], shape: tuple[int, ...]) -> str:
    """Return words for a component: its axes in a 6-vector or 6x6 matrix, else its number from 1.

    Args:
        index: Index of the component in the parameter's array.
        shape: Shape of the array.
    """
    if not index:
        return ""
    names = [AXES[i] if n == 6 else str(i + 1) for i, n in zip(index, shape, strict=True)]
    return f" in {'-'.join(names)}" if set(shape) == {6} else f", component {', '.join(names)}"
