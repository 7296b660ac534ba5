"""Recordings of one study: a changed vehicle whose hull no formula of the catalogue describes."""

from __future__ import annotations

from dataclasses import replace

import polars as pl

from benchmarks.hidden_effects import flights
from benchmarks.hidden_effects.cases import Case, stronger, weaker
from benchmarks.hidden_effects.study import STRONGER, WEAKER, Flown, shares
from benchmarks.imperfect_base.base import SESSIONS, Base
from hydro.core.errors import DataError
from hydro.core.evaluation.replay_error import Ahead

NOISES = (1.0, 0.5, 0.25, 0.1)
"""Times ordinary noise: the greatest in which the base error stands out."""
STANDS_OUT = 5.0
"""Minimum ratio of the base error to the error from noise alone."""
SHARE = 0.1
"""Share of the given file's squared 5 s error that a change is to make."""


def fly(case: Case, known: Base, seconds: float) -> list[pl.DataFrame]:
    """Fly four sessions to diagnose and one to hold out, of `seconds` / 4 each.

    Args:
        case: The change.
        known: The unchanged vehicle.
        seconds: Length of the four sessions [s].

    Raises:
        DataError: The motion diverges.
    """
    rows = [round(seconds / SESSIONS / flights.DT)] * (SESSIONS + 1)
    return flights.by_teacher(
        known.believed,
        case.hidden,
        rows=rows,
        depth=case.depth,
        noise=case.noise,
        seed=case.seed,
        mesh=known.hull,
    )


def standing_out(case: Case, known: Base, seconds: float) -> tuple[Case, float, float]:
    """Return the case with the most noise at which the error of the unchanged file is far above the noise.

    Returns:
        The case, the error of the file without a change, and the noise floor [m/s].

    Raises:
        DataError: The error is near the noise at every level of noise.
    """
    for noise in NOISES:
        quiet = replace(case, noise=noise, hidden=())
        errors = Ahead(fly(quiet, known, seconds)[-1], known.vehicle)
        error = errors.of(known.vehicle)
        if error >= STANDS_OUT * errors.floor:
            return replace(case, noise=noise), error, errors.floor
    raise DataError(f"the file of {case.preset} describes the panels to {error:.3g} m/s, near the noise")


def changed(case: Case, known: Base, seconds: float) -> tuple[Case, Flown, Ahead]:
    """Return a case whose change causes a sufficient share of the error and lets the vehicle fly.

    Returns:
        The case, its recordings, and prediction errors on the held-out session.

    Raises:
        DataError: The motion diverges even with the weakest change.
    """

    def flown(case: Case) -> Flown:
        *measured, held_out = fly(case, known, seconds)
        return Flown(known.vehicle, known.vehicle, pl.concat(measured), held_out)

    for _ in range(WEAKER):
        try:
            found = flown(case)
            break
        except DataError:
            case = weaker(case)
    else:
        found = flown(case)
    for _ in range(STRONGER):
        errors = Ahead(found.held_out, known.vehicle)
        if not case.hidden or shares(case, found, errors, errors.of(known.vehicle))[0] >= SHARE:
            break
        try:
            more = stronger(case, [True])
            case, found = more, flown(more)
        except DataError:
            break
    return case, found, Ahead(found.held_out, known.vehicle)
