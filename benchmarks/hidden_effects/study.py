"""Recordings of one study: a vehicle with detectable hidden effects that can be flown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from benchmarks.hidden_effects import flights, vehicles
from benchmarks.hidden_effects.cases import Case, stronger, weaker
from hydro.core.errors import DataError
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.vehicle.description import Vehicle

SESSIONS = 4
WEAKER = 4
"""Greatest number of times that hidden effects are halved until the vehicle can be flown."""
STRONGER = 5
"""Greatest number of doublings of a hidden effect until it causes the required share of the error."""


@dataclass(frozen=True)
class Flown:
    """Recordings of a study.

    Attributes:
        given: The vehicle file, with wrong damping.
        exact: The file with the right damping, without the hidden effects.
        measured: Sessions to diagnose.
        held_out: One further session.
    """

    given: Vehicle
    exact: Vehicle
    measured: pl.DataFrame
    held_out: pl.DataFrame


def fly(case: Case, seconds: float) -> Flown:
    """Record a case: `seconds` in four sessions, and a held-out session of the same length as each.

    Raises:
        DataError: The motion diverges.
    """
    rows = [round(seconds / SESSIONS / flights.DT)] * (SESSIONS + 1)
    how: dict[str, Any] = {"rows": rows, "depth": case.depth, "noise": case.noise, "seed": case.seed}
    exact = vehicles.preset(case.preset)
    if case.source == "simulate":
        tables = flights.by_simulate(exact, vehicles.joined(exact, case.hidden), **how)
    else:
        tables = flights.independent(exact, exact, case.hidden, case.foreign, **how)
    given = vehicles.misjudged(exact, np.random.default_rng([case.seed, 11]))
    return Flown(given, exact, pl.concat(tables[:-1]), tables[-1])


def flyable(case: Case, seconds: float) -> tuple[Case, Flown]:
    """Record a case; halve the hidden effects while the motion diverges.

    Returns:
        The case as it was flown, and its recordings.

    Raises:
        DataError: The motion diverges even with the weakest hidden effects.
    """
    for _ in range(WEAKER):
        try:
            return case, fly(case, seconds)
        except DataError:
            case = weaker(case)
    return case, fly(case, seconds)


def shares(case: Case, flown: Flown, errors: Ahead, before: float) -> tuple[float, list[float]]:
    """Return the share of the file's squared error 5 s ahead that the hidden effects cause.

    Args:
        case: The case.
        flown: Its recordings.
        errors: Prediction errors on the held-out session.
        before: Error of the vehicle file as given.

    Returns:
        The share of all hidden effects together, and the share of each.
    """
    nothing = errors.of(flown.exact) ** 2
    everything = (
        errors.floor**2 if case.foreign else errors.of(vehicles.joined(flown.exact, case.hidden)) ** 2
    )
    each = []
    for left_out in case.hidden if not case.foreign else ():
        rest = [table for table in case.hidden if table is not left_out]
        each.append(errors.of(vehicles.joined(flown.exact, rest)) ** 2)

    def share(error: float) -> float:
        return float(np.clip((error - everything) / before**2, 0.0, 1.0))

    return share(nothing), [share(error) for error in each]


def telling(case: Case, flown: Flown, seconds: float, least: float) -> tuple[Case, Flown]:
    """Double hidden effects until each causes at least the share `least` of the squared error.

    Returns:
        The last case that could be flown, and its recordings.
    """
    for _ in range(STRONGER):
        errors = Ahead(flown.held_out, flown.exact)
        together, each = shares(case, flown, errors, errors.of(flown.given))
        weak = [share < least for share in (each if len(each) > 1 else [together])]
        if case.foreign or not (case.hidden and any(weak)):
            break
        try:
            more = stronger(case, weak)
            case, flown = more, fly(more, seconds)
        except DataError:
            break
    return case, flown
