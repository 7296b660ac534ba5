"""Plan of the next run: commands that separate rival models within limits of thrust, depth and space.

Manoeuvres of the library are simulated at several thrusts and durations.  A manoeuvre is allowed only if
every predicted position of every model stays within the limits.  The flight is built greedily: each step adds
the allowed manoeuvre with the largest gain in utility (sequential design).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from hydro.core.columns import Array
from hydro.core.effects.sensor import DELAY
from hydro.core.errors import DataError
from hydro.core.experiment.discrimination import (
    Expected,
    Rival,
    Unseen,
    expected,
    gram,
    parted,
    shown,
    unseen,
    utility,
    worth,
)
from hydro.core.experiment.library import FLIGHT_LENGTH, Manoeuvre, library, powers
from hydro.core.experiment.manoeuvres import predicted_shots
from hydro.core.prediction.candidate import Candidate, candidate
from hydro.core.prediction.parameters import LONGEST_SENSOR_DELAY
from hydro.core.recording.shots import SHOT_SECONDS
from hydro.core.simulation.simulate import trajectory

LENGTHS = (FLIGHT_LENGTH, FLIGHT_LENGTH / 2.0, FLIGHT_LENGTH / 4.0)
"""Durations of a session to try, the longest first [s]."""
SHARES = (1.0, 0.7, 0.45, 0.25, 0.12)
"""Shares of the allowed thrust to try; the largest possible and one much smaller share become options."""
LOWER_SHARE = 0.5
"""Maximum ratio of the smaller share of thrust to the larger: a clearly different speed adds information."""
SHORTEST = 2.0 * SHOT_SECONDS
"""Minimum duration of a flight [s]: two shots."""
Pairs = Mapping[tuple[int, int], Array]


@dataclass(frozen=True)
class Limits:
    """Limits of a planned flight, which is a sequence of sessions.

    Attributes:
        depth: Minimum and maximum depth [m].
        space: Maximum horizontal distance from the start of a session [m].
        thrust: Maximum thrust of each thruster, as a share of its full thrust.
        seconds: Total duration of all sessions [s].

    Raises:
        DataError: No flight satisfies the limits.
    """

    depth: tuple[float, float] = (-np.inf, np.inf)
    space: float = np.inf
    thrust: float = 1.0
    seconds: float = 120.0

    def __post_init__(self) -> None:
        """Check that some flight satisfies the limits."""
        low, high = self.depth
        if not low < high:
            raise DataError(f"depth: {low:g} to {high:g} m is empty; give MIN below MAX")
        if not self.space > 0.0:
            raise DataError(f"space: {self.space:g} m leaves no room; give a distance above 0")
        if not 0.0 < self.thrust <= 1.0:
            raise DataError(f"thrust: {self.thrust:g} is not a share of full thrust; give 0.05 to 1")
        if not self.seconds >= SHORTEST:
            raise DataError(f"seconds: {self.seconds:g} s is too short; give at least {SHORTEST:g} s")

    def begin(self, pose: Array) -> Array:
        """Return the start pose of all sessions: the desired pose, with its depth moved inside the limits.

        Args:
            pose: Desired pose x y z phi theta psi, NED, (6,) [m, rad].
        """
        low, high = self.depth
        if low < pose[2] < high:
            return pose
        depth = 0.5 * (low + high) if np.isfinite([low, high]).all() else np.clip(pose[2], low, high)
        return np.array([*pose[:2], depth, *pose[3:]])

    def hold(self, motion: Array) -> bool:
        """Return whether a motion stays within the limits of depth and space.

        Args:
            motion: Pose, NED, and body velocity in N rows, (N, 12) [m, rad, m/s, rad/s].
        """
        away = np.hypot(*(motion[:, :2] - motion[0, :2]).T)
        z, (low, high) = motion[:, 2], self.depth
        return bool(away.max() <= self.space and low <= z.min() and z.max() <= high)


@dataclass(frozen=True)
class Question:
    """Open questions of a diagnosis, with the noise and the start pose of the next run.

    Attributes:
        ties: Groups of rival models; the models of a group explain the recording about equally well.
        model: Vehicle with all findings, used if there are no ties.
        hidden: Names of effects that the recording does not show.
        sigma: Standard deviations of pose and velocity at the library's log rate, (12,) [m, rad, m/s, rad/s]:
            the root mean square residual of each channel, at least the sensor noise.
        pose: Default start pose of a flight, NED, (6,) [m, rad].
        reach: Positions and times of the N rows of the recording, (N, 4) [m, s].
    """

    ties: tuple[tuple[Rival, ...], ...]
    model: Rival
    hidden: tuple[str, ...]
    sigma: Array
    pose: Array
    reach: Array


@dataclass(frozen=True)
class Flight:
    """Recommended flight and its predicted results.

    Attributes:
        sessions: Manoeuvres in their order; each starts at rest.
        start: Start pose of each session, NED, (6,) [m, rad].
        distances: Expected separation of two rival models in standard deviations, by pair of names.
        errors: Expected standard errors of the effects in question.
        depth: Minimum and maximum depth of all predictions [m].
        space: Maximum horizontal distance of all predictions from the start [m].
    """

    sessions: tuple[Manoeuvre, ...]
    start: Array
    distances: Mapping[tuple[str, str], float]
    errors: tuple[Expected, ...]
    depth: tuple[float, float]
    space: float

    def table(self) -> pl.DataFrame:
        """Return the commands as a table for `hydro simulate`: session, t [s], cmd_1 ... cmd_n, -1 to 1."""
        numbered = [replace(one, name=f"{number}_{one.name}") for number, one in enumerate(self.sessions, 1)]
        return pl.concat([one.table() for one in numbered])

    def lines(self) -> Iterator[str]:
        """Yield the lines of a report: the sessions, the space that they need and their predicted results."""
        length = sum(one.seconds for one in self.sessions)
        yield (
            f"{len(self.sessions)} sessions, {length:g} s in all, each from rest, level, heading north, "
            f"at a depth of {self.start[2]:.3g} m:"
        )
        for one in self.sessions:
            yield f"    {one.name}, {one.seconds:g} s: {one.words}"
        yield (
            f"every predicted position stays within {self.space:.2g} m of the start and at depths of "
            f"{self.depth[0]:.3g} to {self.depth[1]:.3g} m"
        )
        for (one_name, other), apart in self.distances.items():
            yield f"expected to part {one_name} from {other} by {apart:.2g} standard deviations"
        for (effect, unit), errors in self._by_effect().items():
            yield f"expected standard error of {effect}: {_range([one.after for one in errors])}{unit}" + (
                f", now {_range([one.before for one in errors])}{unit}"
                if np.isfinite([one.before for one in errors]).all()
                else ""
            )

    def _by_effect(self) -> dict[tuple[str, str], list[Expected]]:
        """Return the expected standard errors by effect and unit."""
        found: dict[tuple[str, str], list[Expected]] = {}
        for one in self.errors:
            unit = f" {one.unit}" if one.unit not in ("", "1") else ""
            found.setdefault((one.name.partition(".")[0], unit), []).append(one)
        return found


def _range(values: Sequence[float]) -> str:
    """Return the smallest and largest of several values as text."""
    low, high = f"{min(values):.2g}", f"{max(values):.2g}"
    return low if low == high else f"{low} to {high}"


@dataclass(frozen=True)
class Option:
    """Manoeuvre that stays within the limits of a flight, with its predicted results.

    Attributes:
        manoeuvre: The manoeuvre.
        grams: For each group of rival models, the Gram matrix (`discrimination.gram`) of model j in the
            flight that model i predicts, by (i, j).
        depth: Minimum and maximum predicted depth [m].
        space: Maximum predicted horizontal distance from the start [m].
    """

    manoeuvre: Manoeuvre
    grams: tuple[Pairs, ...]
    depth: tuple[float, float]
    space: float


def advise(question: Question, limits: Limits) -> Flight:
    """Return the flight that gives most information on the open questions of a diagnosis.

    Args:
        question: Open questions: rival models, or else effects that the recording does not show.
        limits: Limits of the flight.

    Returns:
        The flight, with the separations and standard errors that are expected after it.

    Raises:
        DataError: No question is open, the motion diverges, or no manoeuvre stays within the limits.
    """
    if question.ties:
        groups = question.ties
        options = list(_options(groups, limits, question))
        chosen = _greedy(options, lambda total: _utility(groups, total), limits)
        distances = {
            pair: float(np.sqrt(square))
            for group, grams in zip(groups, _sum_of(chosen), strict=True)
            for pair, square in parted(group, grams).items()
        }
        errors = [
            error
            for group, grams in zip(groups, _sum_of(chosen), strict=True)
            for error in expected(group[0], grams[1, 0])
        ]
    else:
        if not question.hidden:
            raise DataError("the diagnosis leaves nothing open that another run could answer")
        asked = unseen(question.model.vehicle, question.hidden, question.reach)
        options = list(_options(((question.model,),), limits, question, asked))
        model = question.model

        def told(total: Sequence[Pairs]) -> float:
            return worth(asked, shown(model, asked, total[0][0, 0]))

        chosen = _greedy(options, told, limits)
        final = shown(model, asked, _sum_of(chosen)[0][0, 0])
        distances, errors = {}, [error for each in final.values() for error in each]
    return Flight(
        tuple(one.manoeuvre for one in chosen),
        limits.begin(question.pose),
        distances,
        tuple(errors),
        (min(one.depth[0] for one in chosen), max(one.depth[1] for one in chosen)),
        max(one.space for one in chosen),
    )


def _utility(groups: Sequence[Sequence[Rival]], total: Sequence[Pairs]) -> float:
    """Return the utility of manoeuvres for groups of rival models, from the sums of their Gram matrices."""
    return sum(utility(parted(group, grams)) for group, grams in zip(groups, total, strict=True))


def _sum_of(options: Sequence[Option]) -> list[dict[tuple[int, int], Array]]:
    """Return the Gram matrices of each group of models, summed over manoeuvres."""
    first = options[0].grams
    return [
        {pair: np.sum([one.grams[k][pair] for one in options], axis=0) for pair in grams}
        for k, grams in enumerate(first)
    ]


def _greedy(
    options: Sequence[Option], told: Callable[[list[dict[tuple[int, int], Array]]], float], limits: Limits
) -> list[Option]:
    """Choose manoeuvres one by one, each with the largest gain in utility, until the time is used up.

    Args:
        options: Manoeuvres within the limits.
        told: Function from the summed Gram matrices of the chosen manoeuvres to their utility.
        limits: Limits of the flight; only the total duration is used here.

    Raises:
        DataError: No manoeuvre fits.
    """
    left, chosen = limits.seconds, list[Option]()
    while True:
        fitting = [one for one in options if one.manoeuvre.seconds <= left + 1e-9]
        if not fitting:
            break
        chosen.append(max(fitting, key=lambda one: told(_sum_of([*chosen, one]))))
        left -= chosen[-1].manoeuvre.seconds
    if not chosen:
        low, high = limits.depth
        raise DataError(
            f"no manoeuvre keeps every prediction within {limits.space:g} m of its start and {low:g} to "
            f"{high:g} m deep; give more --space, --depth or --thrust"
        )
    return chosen


def _options(
    groups: Sequence[Sequence[Rival]], limits: Limits, question: Question, asked: Sequence[Unseen] = ()
) -> Iterator[Option]:
    """Yield the manoeuvres within the limits, with the Gram matrices of all pairs of models in each group."""
    rivals = [rival for group in groups for rival in group]
    models = [candidate(rival.vehicle) for rival in rivals]
    lead = LONGEST_SENSOR_DELAY if any(model.log[DELAY] for model in models) else 0.0
    more = [column for one in asked for column in one.columns]
    for manoeuvre, motions in _flyable(rivals[0], models, limits, limits.begin(question.pose)):
        shots = [
            predicted_shots(model, manoeuvre, motion, question.sigma, lead)
            for model, motion in zip(models, motions, strict=True)
        ]
        grams, place = list[Pairs](), 0
        for group in groups:
            count = range(len(group))
            pairs = [(i, j) for i in count for j in count if i != j or len(group) == 1]
            grams.append({(i, j): gram(group[j], shots[place + i], more) for i, j in pairs})
            place += len(group)
        if all(np.isfinite(one).all() for pairs_ in grams for one in pairs_.values()):
            every = np.concatenate(motions)
            away = max(float(np.hypot(*(m[:, :2] - m[0, :2]).T).max()) for m in motions)
            yield Option(manoeuvre, tuple(grams), (float(every[:, 2].min()), float(every[:, 2].max())), away)


def _flyable(
    rival: Rival, models: Sequence[Candidate], limits: Limits, start: Array
) -> Iterator[tuple[Manoeuvre, list[Array]]]:
    """Yield the manoeuvres that every model can fly within the limits, with the models' motions, (N, 12).

    A shorter duration is tried only if a longer one exceeds the limits at the full allowed thrust.
    """
    curves, done = powers(rival.vehicle), set[str]()
    lengths = [one for one in LENGTHS if one <= limits.seconds] or [limits.seconds]
    for seconds in lengths:
        for whole in library(rival.vehicle, seconds, by_hand=False):
            if whole.name in done:
                continue
            greatest = 0.0
            for share in SHARES:
                if greatest and share > LOWER_SHARE * greatest:
                    continue
                manoeuvre = whole.thrusting(share * limits.thrust, curves)
                motions = _motions_within(manoeuvre, models, limits, start)
                if motions is None:
                    continue
                named = f"{whole.name} at {share * limits.thrust:.0%}"
                yield replace(manoeuvre, name=named), motions
                if greatest:
                    break
                greatest = share
            if greatest == SHARES[0]:
                done.add(whole.name)


def _motions_within(
    manoeuvre: Manoeuvre, models: Sequence[Candidate], limits: Limits, start: Array
) -> list[Array] | None:
    """Return the motions of all models, (N, 12) each, or None if one exceeds the limits or diverges."""
    motions = []
    for model in models:
        try:
            motion = trajectory(model.program, manoeuvre.commands, manoeuvre.t, eta=start, steps=1)
        except DataError:
            return None
        if not limits.hold(motion):
            return None
        motions.append(motion)
    return motions
