"""Thruster audit: directions, order and effectiveness of all thrusters, from one recording.

The audit precedes the search for effects.  No effect can imitate a reversed thruster or a command column of
another thruster, but such an error biases every fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import polars as pl
import polars.selectors as cs

from hydro.core.audit.hypotheses import FACTORS, INERTIA, SPREAD, Posterior, effectiveness, posterior
from hydro.core.audit.momentum_balance import Balance, balance
from hydro.core.audit.wiring import Wiring
from hydro.core.columns import DOF, VELOCITY, Array, Mask, Rows, command_column
from hydro.core.effects import wording
from hydro.core.errors import in_shell, listed
from hydro.core.interval import NORMAL_95
from hydro.core.recording.arrays import Recording
from hydro.core.vehicle.description import Vehicle

SURE = 0.95
"""Minimum probability at which the audit states directions and order."""
STATED = 3.0
"""Minimum deviation of the common scale from 1 that the audit states [standard errors].

It gives one false alarm in 370.
"""
TOGETHER = 0.5
"""Minimum absolute correlation of the effectivenesses of thrusters that form a group."""
WEAK = 0.5
"""Upper limit of the whole interval of a weak thruster, relative to the common scale."""
MOST = 0.5
"""Maximum scatter of the effectivenesses with another order or other signs, relative to that with the file's:
a swap or a reversed thruster that is there explains most of it.  In logs of four simulators of others it is
0.1 to 0.25 for mistakes that are there, and 1 to 3 for those claimed because the file's drag or inertia is
wrong."""
CLEARLY = 2.0
"""Squared residual of predictions with the stated order, relative to that with the file's, above which
predictions contradict the audit.  Its median is at most 1.2 for 45 planted mistakes with first-guess files,
and 12.7 for a mistake that was not there."""
MOST_ALTERNATIVES, LIKELY = 3, 0.05
"""Maximum number of listed alternatives, and their minimum probability."""


@dataclass(frozen=True)
class ThrusterAudit:
    """Result of a thruster audit: directions, order and effectiveness of n actuators.

    The effectiveness of a thruster is its thrust relative to the file's.  An assignment says which command
    column drives each thruster, and with which sign.

    Attributes:
        wiring: Assignment that the audit states; that of the file if nothing else is certain.
        probability: Probability of `wiring`.
        plain: Probability that all directions and the order are those of the file.
        alternatives: Most probable assignments, with probabilities, if the file is wrong and none is certain.
        effectiveness: Effectiveness of each thruster with the column that drives it, (n,); negative if it
            pushes opposite to the file; NaN for servos.
        low: Lower end of the 95 % interval of the effectiveness, (n,).
        high: Upper end of the 95 % interval of the effectiveness, (n,).
        scale: Thrust of all thrusters relative to the file: estimate, low and high end of its 95 % interval.
        seen: Whether the individual effectiveness of each thruster is determined, (n,).
        clear: Whether a thruster of `seen` has a certain direction, (n,); False for a dead thruster.
        together: Groups of thrusters that the recording cannot separate, by index from 0.
        weak: Whether a thruster of `seen` hardly pushes, unless too small an inertia may be the cause, (n,).
        idle: Whether each thruster did not run, (n,).
        shown: Whether the acceleration of each of u v w p q r was measured and is used, (6,).
        held: Whether it was measured but is not used, because the commands oppose the motion there, (6,).
        delay: Delay from command to motion [s].
        contradicted: Whether predictions are worse with `wiring` than with the file's own directions and
            order, so that these stay.
    """

    wiring: Wiring
    probability: float
    plain: float
    alternatives: tuple[tuple[Wiring, float], ...]
    effectiveness: Array
    low: Array
    high: Array
    scale: tuple[float, float, float]
    seen: Mask
    clear: Mask
    together: tuple[tuple[int, ...], ...]
    weak: Mask
    idle: Mask
    shown: Mask
    held: Mask
    delay: float
    contradicted: bool = False

    @property
    def wrong(self) -> bool:
        """Whether directions or order certainly differ from the file, even if the difference is ambiguous."""
        return self.plain <= 1.0 - SURE and not self.contradicted

    def columns(self) -> tuple[str, ...]:
        """Return sorted names of command columns that `wiring` or an alternative exchanges or reverses."""
        every = [self.wiring, *(wiring for wiring, _ in self.alternatives)]
        return tuple(sorted({name for wiring in every for name in wiring.columns()}))

    def lines(self, file: str = "", sources: Sequence[str] | None = None) -> Iterator[str]:
        """Yield the results of the audit, one sentence each, most important first.

        Args:
            file: Name of the vehicle file, for the command that corrects it; empty if unknown.
            sources: Names of the columns in the log, in the order of the map; None without a map.
        """
        if self.contradicted:
            yield f"the accelerations look as if {self._told(self.wiring)}"
            yield "predictions are worse like that: directions and order stay, a missing force is likelier"
        else:
            if self.clear.any() and not self.wrong:
                yield self.headline()
            yield from self.statements(file, sources)
            yield from self._unseen()
        if self.held.any():
            yield (
                f"a controller opposes the motion on {listed(_axes(self.held, DOF))}: "
                "the accelerations there do not show directions and are not used"
            )
        if hidden := _axes(~self.shown & ~self.held, VELOCITY):
            yield f"accelerations of {listed(hidden)} are not measured and not used"

    def statements(self, file: str = "", sources: Sequence[str] | None = None) -> Iterator[str]:
        """Yield sentences on contradictions of the file: directions, order, common scale, weak thrusters.

        Args:
            file: Name of the vehicle file, for the command that corrects it; empty if unknown.
            sources: Names of the columns in the log, in the order of the map; None without a map.
        """
        if self.wrong:
            yield self.headline(file, sources)
        if self.seen.any():
            yield from self._sizes()

    def headline(self, file: str = "", sources: Sequence[str] | None = None) -> str:
        """Return a sentence on directions and order, with the command or map line that corrects them.

        Args:
            file: Name of the vehicle file, for the command that corrects it; empty if unknown.
            sources: Names of the columns in the log, in the order of the map; None without a map.
        """
        if not self.wrong:
            clear = _places(self.clear)
            verb = "pushes" if len(clear) == 1 else "push"
            return f"{wording.group(i + 1 for i in clear)} {verb} as the file says"
        if self.wiring.is_plain:
            likely = ", or ".join(
                f"{self._told(wiring)} ({100 * chance:.0f} %)" for wiring, chance in self.alternatives
            )
            return (
                "thruster directions or order differ from the file, but the recording does not show how: "
                f"{likely or 'no single change explains it'}; run each thruster alone"
            )
        told = f"{self._told(self.wiring)} ({100 * self.probability:.0f} % sure)"
        advice = []
        if self.wiring.reversed:
            numbers = ",".join(str(i + 1) for i in self.wiring.reversed)
            given = f" {in_shell(file)} --thruster {numbers} -o flipped.toml" if file else ""
            advice.append(f"flip {_it(self.wiring.reversed)} with `hydro vehicle flip{given}`")
        if self.wiring.moved:
            advice.append(self._order(sources))
        return f"{told}: {'; '.join(advice)}"

    def table(self) -> pl.DataFrame:
        """Return a new table with one row per actuator.

        Columns: `thruster` (from 1); `effectiveness` with its 95 % interval `low` to `high` (null for
        servos); and `seen`, whether the effectiveness is determined.
        """
        return pl.DataFrame(
            {
                "thruster": range(1, len(self.seen) + 1),
                "effectiveness": self.effectiveness,
                "low": self.low,
                "high": self.high,
                "seen": self.seen,
            }
        ).with_columns(cs.float().fill_nan(None))

    def _told(self, wiring: Wiring) -> str:
        """Return the directions and order of an assignment in words."""
        parts = []
        if wiring.reversed:
            verb = "pushes" if len(wiring.reversed) == 1 else "push"
            parts.append(f"{_thrusters(wiring.reversed)} {verb} opposite to the file")
        moved = wiring.moved
        if len(moved) == 2 and all(wiring.sign[i] > 0 for i in moved):
            parts.append(f"columns {moved[0] + 1} and {moved[1] + 1} are swapped")
        elif moved:
            each = [
                f"{command_column(wiring.column[i])} drives thruster {i + 1}"
                + (" in reverse" if wiring.sign[i] < 0 else "")
                for i in moved
            ]
            parts.append(", ".join(each))
        return "; ".join(parts) or "all is as the file says"

    def _order(self, sources: Sequence[str] | None) -> str:
        """Return how to correct the order of columns: the line of the map, or the order in words."""
        turned = {i for i in self.wiring.moved if self.wiring.sign[i] < 0}
        if sources:
            columns = [
                f'{{ column = "{sources[column]}", reverse = true }}'
                if i in turned
                else f'"{sources[column]}"'
                for i, column in enumerate(self.wiring.column)
            ]
            return f"write in the map, under [commands]: columns = [{', '.join(columns)}]"
        order = ", ".join(
            f"{column + 1}{' reversed' if i in turned else ''}" for i, column in enumerate(self.wiring.column)
        )
        return f"put the columns of [commands] in the map in the order {order}"

    def _unseen(self) -> Iterator[str]:
        """Yield sentences on the thrusters for which the audit has no result."""
        if idle := _places(self.idle):
            yield f"{_thrusters(idle)} did not run: no result for {_it(idle)}"
        grouped = set(idle)
        for group in self.together:
            grouped |= set(group)
            yield (
                f"{_thrusters(group)} act alike in this recording and cannot be separated: "
                "no result for single ones; run each of them alone"
            )
        rest = tuple(i for i in _places(~self.clear & ~self.weak) if i not in grouped)
        if rest:
            yield f"this recording does not show the direction of {_thrusters(rest, 'thruster')}"

    def _sizes(self) -> Iterator[str]:
        """Yield sentences on a common scale far from 1, and on weak thrusters."""
        scale, low, high = self.scale
        words = f"{scale:.2f} times the thrust of the file (95 % interval {low:.2f} to {high:.2f})"
        if abs(np.log(scale)) > STATED / NORMAL_95 * np.log(high / scale):
            yield f"common factor: {words}; check supply voltage, thrust curve, command scale and inertia"
        for i in _places(self.weak):
            yield (
                f"thruster {i + 1} hardly pushes: {self.effectiveness[i]:.2f} times the file's thrust "
                f"(95 % interval {self.low[i]:.2f} to {self.high[i]:.2f})"
            )


def audit(vehicle: Vehicle, record: Recording, beside: Array | None = None) -> ThrusterAudit | None:
    """Return the audit of a file's thrusters in a recording: their directions, order and effectiveness.

    Args:
        vehicle: The vehicle.
        record: The recording.
        beside: Known wrench on the hull in addition to the forces of the file, at every row, (N, 6) [N, N m].

    Returns:
        The audit, or None if there are no thrusters, too few windows or no measured acceleration.
    """
    found = balance(vehicle, record, beside)
    return None if found is None else _concluded(found, posterior(found), len(vehicle.thruster))


def _concluded(found: Balance, tried: Posterior, count: int) -> ThrusterAudit:
    """Derive the audit from the probabilities of all hypotheses."""
    ranked = _explaining(found, tried)
    likeliest, driven = ranked[0][0], found.driven
    strength, covariance = effectiveness(found, likeliest.column)
    signs = np.array(likeliest.sign, float)
    scale, scale_error = _scale(signs * strength, covariance)
    common = _common_error(found)
    errors = np.sqrt(np.diagonal(covariance))
    seen = (NORMAL_95 * errors < scale) & ~found.idle
    together = _groups(covariance, seen, found.idle, scale)
    plain = sum(chance for wiring, chance in ranked if wiring.is_plain)
    turned = _turned(ranked)
    both = np.stack([turned, tried.turned(likeliest.column)])  # a dead thruster has no direction
    clear = seen & (np.abs(both - 0.5) >= SURE - 0.5).all(axis=0)
    stated, probability, alternatives = _stated(ranked, turned, plain, seen)
    half = NORMAL_95 * np.hypot(errors, common * np.abs(strength))
    weak = _weak(found, np.abs(strength) + half, seen, scale)
    return ThrusterAudit(
        wiring=_spread(stated, driven, count),
        probability=probability,
        plain=plain,
        alternatives=tuple((_spread(wiring, driven, count), chance) for wiring, chance in alternatives),
        effectiveness=_full(strength, driven, count, np.nan),
        low=_full(strength - half, driven, count, np.nan),
        high=_full(strength + half, driven, count, np.nan),
        scale=_interval(scale, np.hypot(scale_error / max(scale, 1e-9), common)),
        seen=_full(seen, driven, count, False),
        clear=_full(clear, driven, count, False),
        together=tuple(tuple(int(driven[i]) for i in group) for group in together),
        weak=_full(weak, driven, count, False),
        idle=_full(found.idle, driven, count, False),
        shown=found.shown,
        held=found.held,
        delay=found.delay,
    )


def _explaining(found: Balance, tried: Posterior) -> list[tuple[Wiring, float]]:
    """Return hypotheses with their probabilities, of which each change explains most of what is wrong.

    The probability of any other counts for a simpler one, at last for the file.  A wrong drag or inertia of
    the file can make an exchange likelier than the file's order.  But then the thrusters differ from one
    another no less than before: one error takes the place of another.
    """

    @cache
    def scatter(wiring: Wiring) -> float:
        strength, covariance = effectiveness(found, wiring.column)
        return _scatter(np.array(wiring.sign, float) * strength, covariance)

    @cache
    def simplest(wiring: Wiring) -> Wiring:
        if wiring.is_plain:
            return wiring
        simpler = min(wiring.simpler(), key=scatter)
        return wiring if scatter(wiring) <= MOST * scatter(simpler) else simplest(simpler)

    chances = dict[Wiring, float]()
    for wiring, chance in tried.wirings():
        stands = simplest(wiring)
        chances[stands] = chances.get(stands, 0.0) + chance
    return sorted(chances.items(), key=lambda each: -each[1])


def _scatter(forward: Array, covariance: Array) -> float:
    """Return the squared deviation of effectivenesses from their mean, in natural spreads and errors.

    It is infinite for a mean below 0, where the thrusters push opposite to the hypothesis.

    Args:
        forward: Effectivenesses times the signs of a hypothesis, (n,).
        covariance: Their covariance, (n, n).
    """
    identity, mean = np.eye(len(forward)), 0.0
    for _ in range(2):  # the natural spread is relative to the mean
        inverse = np.linalg.inv(covariance + (SPREAD * mean) ** 2 * identity)
        mean = float((inverse @ forward).sum() / inverse.sum())
    if mean <= 0.0:
        return np.inf
    away = forward - mean
    return float(away @ np.linalg.solve(covariance + (SPREAD * mean) ** 2 * identity, away))


def _weak(found: Balance, most: Array, seen: Mask, scale: float) -> Mask:
    """Return which thrusters hardly push, (n,).

    If all thrusters that push along one axis are alike, the axis may be heavier than in the file instead.  A
    thruster is weak there only if no error of the inertia explains it.

    Args:
        found: Sufficient statistics of the regression.
        most: Largest effectiveness of each thruster within its interval, in either direction, (n,).
        seen: Thrusters whose effectiveness is determined, (n,).
        scale: Common scale.
    """
    count = len(most)
    own = found.kinds * count + np.arange(count)
    told = found.gram[:, own, own] * found.arms**2
    axis = told.argmax(axis=0)
    low = seen & (most < WEAK * scale)
    beside = np.array([(seen & ~low & (axis == axis[i])).any() for i in range(count)], bool)
    return low & (beside | (most < FACTORS[0] * scale))


def _turned(ranked: Sequence[tuple[Wiring, float]]) -> Array:
    """Return the probability that each thruster is reversed, (n,), given the likeliest column order."""
    column, total = ranked[0][0].column, 0.0
    found = np.zeros(len(column))
    for wiring, chance in ranked:
        if wiring.column == column:
            found += chance * (np.array(wiring.sign) < 0)
            total += chance
    return found / total


def _stated(
    ranked: Sequence[tuple[Wiring, float]], turned: Array, plain: float, seen: Mask
) -> tuple[Wiring, float, tuple[tuple[Wiring, float], ...]]:
    """Return the stated assignment, its probability, and alternatives if the file is certainly wrong.

    A thruster is stated as reversed if its marginal probability reaches SURE.  So a dead thruster, whose sign
    is not determined, does not weaken the statement about the other thrusters.

    Args:
        ranked: Assignments with probabilities, most probable first.
        turned: Probability that each thruster is reversed, (n,).
        plain: Probability of the file's assignment.
        seen: Thrusters whose effectiveness is determined, (n,).
    """
    likeliest, probability = ranked[0]
    file = Wiring.plain(len(likeliest.column))
    if plain > 1.0 - SURE:
        return file, plain, ()
    order = sum(chance for wiring, chance in ranked if wiring.column == likeliest.column)
    sure = (turned >= SURE) & seen
    stated = Wiring(likeliest.column, tuple(np.where(sure, -1, 1).tolist()))
    if order >= SURE and seen[list(likeliest.moved)].all() and not stated.is_plain:
        return stated, float(min([order, *turned[sure]])), ()
    open_ = tuple((wiring, chance) for wiring, chance in ranked[:MOST_ALTERNATIVES] if chance >= LIKELY)
    return file, probability, tuple(one for one in open_ if not one[0].is_plain)


def _scale(strength: Array, covariance: Array) -> tuple[float, float]:
    """Return the common scale of effectivenesses (n,) with known signs, and its standard error.

    It is a random-effects mean: the scatter of the thrusters is estimated too (DerSimonian and Laird 1986).
    """
    weights = 1.0 / np.diagonal(covariance)
    mean = float((weights * strength).sum() / weights.sum())
    excess = float((weights * (strength - mean) ** 2).sum()) - (len(strength) - 1)
    room = float(weights.sum() - (weights**2).sum() / weights.sum())
    between = max(excess / room, 0.0) if room > 0.0 else 0.0
    inverse = np.linalg.inv(covariance + between * np.eye(len(strength)))
    total = float(inverse.sum())
    return max(float((inverse @ strength).sum() / total), 1e-3), float(np.sqrt(1.0 / total))


def _common_error(found: Balance) -> float:
    """Return the standard error of the logarithm of the scale due to errors of the file's inertia.

    Errors stated in a file have one cause, the estimate of the hull, and are assumed fully correlated.
    """
    axes = max(int(found.shown.sum()), 1)
    return float(max(INERTIA / np.sqrt(axes), found.inertia[found.shown].sum() / axes))


def _interval(middle: float, error: float) -> tuple[float, float, float]:
    """Return a positive number with its 95 % interval, from the standard error of its logarithm."""
    with np.errstate(over="ignore"):  # the interval of thrusters that never ran is infinite
        factor = float(np.exp(NORMAL_95 * error))
    return middle, middle / factor, middle * factor


def _groups(covariance: Array, seen: Mask, idle: Mask, scale: float) -> list[tuple[int, ...]]:
    """Return connected groups of undetermined thrusters with correlated effectivenesses."""
    spread = np.sqrt(np.diagonal(covariance))
    alike = np.abs(covariance / np.outer(spread, spread)) > TOGETHER
    left = list(_places(~seen & ~idle))
    found = []
    while left:
        group, waiting = [left.pop(0)], [0]
        while waiting:
            at = group[waiting.pop()]
            for other in [i for i in left if alike[at, i]]:
                left.remove(other)
                waiting.append(len(group))
                group.append(other)
        if len(group) > 1:
            found.append(tuple(sorted(group)))
    return found


def _spread(wiring: Wiring, driven: Rows, count: int) -> Wiring:
    """Return an assignment of the thrusters as one of all actuators of the file, including servos.

    Args:
        wiring: Assignment of the thrusters.
        driven: Indices of the thrusters among the actuators, (n,).
        count: Number of actuators.
    """
    column, sign = list(range(count)), [1] * count
    for at, (own, turned) in zip(driven, wiring.drives(), strict=True):
        column[at], sign[at] = int(driven[own]), turned
    return Wiring(tuple(column), tuple(sign))


def _full(values: Any, driven: Rows, count: int, other: Any) -> Any:
    """Return values for all actuators from those of the thrusters (n,), with `other` for servos."""
    out = np.full(count, other)
    out[driven] = values
    return out


def _places(mask: Mask) -> tuple[int, ...]:
    """Return the indices at which a mask is true."""
    return tuple(int(i) for i in np.flatnonzero(mask))


def _axes(mask: Mask, names: Sequence[str]) -> list[str]:
    """Return the names of the axes at which a mask (6,) is true."""
    return [name for name, marked in zip(names, mask, strict=True) if marked]


def _thrusters(indices: Sequence[int], word: str = "thruster") -> str:
    """Return thruster numbers from 1 in words: `thrusters 1, 2 and 5` for the indices 0, 1 and 4."""
    return f"{word}{'s' if len(indices) > 1 else ''} {listed([str(i + 1) for i in indices])}"


def _it(indices: Sequence[int]) -> str:
    """Return "it" for one thruster, "them" for several."""
    return "it" if len(indices) == 1 else "them"
