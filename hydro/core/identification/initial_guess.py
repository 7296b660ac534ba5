"""Initial guesses for effects that are not linear in all of their parameters.

Most such parameters have no influence while the effect is zero: a payload without weight may be anywhere.  So
the effect is replaced by columns of a linear problem (`identification.suspects`), such as the payload's
weight and its three moments.  Their coefficients, fitted with all other free components, give the weight and
its position.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.effects.catalogue import CATALOGUE
from hydro.core.identification.levenberg_marquardt import Problem, linear_step, moved
from hydro.core.identification.suspects import every_shape, is_curved
from hydro.core.prediction.parameters import Free
from hydro.core.vehicle.description import catalogue_name

KEPT = 4
"""Maximum number of shapes of one effect that a fit starts from, ranked by explained residual."""


def initial_guesses(unknown: Free, problem: Problem, reach: Array) -> tuple[Array, ...]:
    """Return several vectors of initial values of the free components, (P,) each, the best first.

    If all effects are linear, these are the starts that `unknown` has.

    Args:
        unknown: The P free components.
        problem: Least-squares problem that is fitted.
        reach: Positions [m] and times [s] in the N rows of the recording, (N, 4).
    """
    names = [name for name in _curved(unknown) if _open(unknown, name)]
    if not names:
        return unknown.starts
    begun = [_begun(unknown, name, problem, reach) for name in names]
    found = []
    for choice in itertools.product(*begun):
        values = choice[0][1].copy()
        for name, (_, other) in zip(names, choice, strict=True):
            values[_own(unknown, name)] = other[_own(unknown, name)]
        found.append((sum(cost for cost, _ in choice), unknown.within(values)))
    return tuple(values for _, values in sorted(found, key=lambda pair: pair[0])[:KEPT])


def elsewhere(unknown: Free, values: Array, problem: Problem, reach: Array, cost: float) -> tuple[Array, ...]:
    """Return other initial values of the free components that may lead to a smaller cost than a fit has.

    A fit that starts from wrong values of the file may end in a local minimum: for example, with a tether
    whose anchor is wrong by the tether's length, or with a delay that does not exist.  So all trial shapes of
    each nonlinear effect are tried, too.

    Args:
        unknown: The P free components.
        values: Fitted values of the components, (P,).
        problem: Least-squares problem that is fitted.
        reach: Positions [m] and times [s] in the N rows of the recording, (N, 4).
        cost: Sum of squares at `values`; only guesses with a smaller predicted cost are returned.

    Returns:
        At most one vector of initial values, (P,), for each nonlinear effect of the file, the best first.
    """
    here, found = replace(unknown, vehicle=unknown.at(values), starts=(values,)), []
    for name in _curved(unknown):
        if name in unknown.known:
            begun = _begun(here, name, problem, reach)
            if begun and begun[0][0] < cost:
                found.append(begun[0])
    return tuple(unknown.within(values) for _, values in sorted(found, key=lambda pair: pair[0]))


def _curved(unknown: Free) -> list[str]:
    """Return the effects that are not linear, in reverse order of the catalogue."""
    places = {name: place for place, name in enumerate(CATALOGUE)}
    names = unknown.effects
    return sorted(filter(is_curved, names), key=lambda name: -places[catalogue_name(name)])


def _own(unknown: Free, name: str) -> NDArray[np.bool_]:
    return np.array([entry.effect == name for entry in unknown.entries])


def _open(unknown: Free, name: str) -> bool:
    """Return whether the initial values of an effect are free: it is new, and the caller gave no values."""
    return bool((np.ptp(np.array(unknown.starts), axis=0) > 0.0)[_own(unknown, name)].any())


def _begun(unknown: Free, name: str, problem: Problem, reach: Array) -> list[tuple[float, Array]]:
    """Return the best shapes of one effect: squared residual and values (P,) of all components for each."""
    start, mine, record = unknown.starts[0], _own(unknown, name), CATALOGUE[name]
    written = record.written(unknown.vehicle.effects(name)[0])
    rest = unknown.holding(start, mine)
    rest = replace(rest, vehicle=rest.vehicle.without(name))
    changed, steps = moved(rest, rest.starts[0])
    count, groups = len(changed), []
    for suspect in every_shape(rest.vehicle, catalogue_name(name), reach=reach):
        groups.append((suspect, [*range(count), *range(len(changed), len(changed) + len(suspect.steps))]))
        changed += suspect.changed
        steps += suspect.steps
    normal = problem.linearise(rest.vehicle, changed, steps)
    found = []
    for suspect, columns in groups:
        gain, step = linear_step(normal, columns)
        table = suspect.begin(step[count:])
        if record.written(table) != written:  # a different object, such as a fin on another command
            continue
        values = start.copy()
        values[~mine] = rest.within(rest.starts[0] + step[:count] * rest.scales)
        values[mine] = _values(unknown, mine, table)
        found.append((normal.cost - gain, values))
    return sorted(found, key=lambda pair: pair[0])[:KEPT]


def _values(unknown: Free, mine: NDArray[np.bool_], table: Mapping[str, Any]) -> Array:
    """Return the components of one effect from its table."""
    own = [entry for entry, chosen in zip(unknown.entries, mine, strict=True) if chosen]
    return np.array([float(np.asarray(table[entry.parameter])[entry.index]) for entry in own])
