"""Does each command column drive the thruster of its number?  Columns exchanged or reversed, by force alone.

A column that belongs to another thruster pushes where the file does not expect it, and no effect does that:
added mass and damping bend until they fit best.  So before any effect is thought of, the accelerations of the
recording (equation error, `prediction.weak_form`) are held against every exchange of two columns and
every reversal. A constant wrench, all that the file's own effects could be otherwise, and whatever part of
its thrust each thruster may lack are free meanwhile, so that a worn or dead thruster is none of this.

Where a recording before has taught what the hull does beside its file, that is taken out in a second trial:
on a hull that the file describes poorly it may be most of what the accelerations leave.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np

from hydro.core.columns import Array, Rows, command_column
from hydro.core.effects.catalogue import own_effects, with_role
from hydro.core.effects.layout import INVERSE_MASS_MATRIX
from hydro.core.effects.program import constants_of
from hydro.core.effects.record import Role
from hydro.core.evaluation.block_resampling import weights
from hydro.core.identification.levenberg_marquardt import moved
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.parameters import free
from hydro.core.prediction.weak_form import Windows
from hydro.core.recording.arrays import Recording
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import UNIT_WRENCH, thrusts

MOST_WINDOWS = 200
"""Windows that are looked at, spread evenly."""
LEAST_WINDOWS, SHORTEST = 24, 5.0
"""Windows, and length of the longest piece without a gap [s], that tell anything."""
GROSS, PLAIN = 0.5, 0.85
"""Part of what the file's order leaves unexplained that another may leave; and where the thrusters in
question push as the file says by that order, and but little by the file's."""
NEAR, LITTLE = 0.5, 0.5
"""Relative deviation of a thrust from the file's that is as it says, and multiple of it that is little."""
MOSTLY = 0.75
"""Part of the recording's stretches in which it must leave less."""
BESIDE = with_role(Role.OFTEN_LACKING)
"""Effects that a file often lacks, so that they do not hide an exchange."""
REMAINING = 0.95
"""Part of what is left that one more exchange or reversal may leave at most."""
THRUSTS = (0.0, 1.5)
"""Multiples of a thrust that are no matter of its column: from dead to half as much again."""
STEPS = 50
"""Of the least squares for thrusts, at most: each takes a thrust to a bound or lets one go."""
RIDGE = 1e-8
"""Part of its own answer by which a thruster is held to the file's where others do the same as it."""
NOTHING = 1e-12
"""Part of the greatest answer below which a thruster does not move at all."""
BOOTSTRAP_STRETCHES, RESAMPLES = 20, 1000
LEAST_CONFIDENCE = 0.9
"""Of an order that is told."""
WRENCH = 6


@dataclass(frozen=True)
class Wiring:
    """Which column drives each thruster.

    Attributes:
        column: Number of the column, from 0, for each thruster.
        sign: 1, or -1 where the column is reversed.
    """

    column: tuple[int, ...]
    sign: tuple[int, ...]

    @classmethod
    def plain(cls, count: int) -> Wiring:
        """As the file says."""
        return cls(tuple(range(count)), (1,) * count)

    def guesses(self) -> Iterator[Wiring]:
        """Where to begin: as it is, all reversed, and numbered from the other end."""
        yield self
        yield Wiring(self.column, tuple(-sign for sign in self.sign))
        yield Wiring(self.column[::-1], self.sign)

    def changes(self) -> Iterator[Wiring]:
        """Every exchange of the columns of two thrusters, with every sign, and every reversal."""
        count = len(self.column)
        for i in range(count):
            yield self._with({i: (self.column[i], -self.sign[i])})
        for i, k in combinations(range(count), 2):
            for a, b in product((1, -1), repeat=2):
                yield self._with({i: (self.column[k], a), k: (self.column[i], b)})

    def _with(self, changed: dict[int, tuple[int, int]]) -> Wiring:
        both = [changed.get(i, pair) for i, pair in enumerate(self.drives())]
        return Wiring(tuple(c for c, _ in both), tuple(s for _, s in both))

    @property
    def others(self) -> int:
        """How many thrusters have another column, and how many are reversed, in all."""
        return sum((column != i) + (sign < 0) for i, (column, sign) in enumerate(self.drives()))

    def drives(self) -> Iterator[tuple[int, int]]:
        """Column and sign of each thruster."""
        return zip(self.column, self.sign, strict=True)

    def apply(self, commands: Array) -> Array:
        """Commands (N, n) in the order and with the signs that the file means."""
        return np.ascontiguousarray(commands[:, list(self.column)] * np.array(self.sign, float))

    def columns(self) -> tuple[str, ...]:
        """Columns that do not drive the thruster of their number, or drive it in reverse."""
        drives = enumerate(self.drives())
        return tuple(
            sorted(command_column(column) for i, (column, sign) in drives if (column, sign) != (i, 1))
        )

    def words(self) -> str:
        """What is other than the file says: `cmd_2 drives thruster 1`."""
        changed = [
            f"{'minus ' if sign < 0 else ''}cmd_{column + 1} drives thruster {i + 1}"
            for i, (column, sign) in enumerate(self.drives())
            if (column, sign) != (i, 1)
        ]
        return ", ".join(changed)


@dataclass(frozen=True)
class Rewired:
    """Another order of the columns that explains the accelerations far better.

    Attributes:
        wiring: It.
        left: Part of what the file's order leaves unexplained that this one leaves.
        confidence: Part of the resampled recordings in which that is little enough.
    """

    wiring: Wiring
    left: float
    confidence: float


def rewired(vehicle: Vehicle, record: Recording, beside: Array | None = None) -> Rewired | None:
    """The order of the command columns that the accelerations ask for.

    Args:
        vehicle: The vehicle.
        record: The recording.
        beside: What the hull does beside the file at every row, (N, 6) [N, N m]; None where nobody knows.

    Returns:
        None where the file's is as good, or the recording too short to tell or blind on an axis.
    """
    count, longest = record.commands.shape[1], np.diff(record.segments, axis=1).max()
    if not count or longest * record.dt < SHORTEST:
        return None
    windows = Windows.of(record, most=MOST_WINDOWS)
    if len(windows.starts) < LEAST_WINDOWS or not windows.shown.all():
        return None
    left = windows.residuals(vehicle)[:, :WRENCH]
    answers, free_ = _answers(vehicle, windows), _free(vehicle, windows)
    known = [] if beside is None else [left - _summed(windows, beside @ _accelerated(vehicle, windows))]
    for each in (left, *known):
        problem = _Problem.of(each, answers, free_)
        for order in _orders(problem):
            if (found := _told(problem, order)) is not None:
                return found
    return None


def _orders(problem: _Problem) -> Iterator[Wiring]:
    """The order that explains most, then ever nearer ones to the file's, the best first; not the file's.

    An exchange or reversal too many, which what the file lacks asks for, does not hide the others.
    """
    guesses = Wiring.plain(len(problem.answers)).guesses()
    found = min((_improved(problem, begun) for begun in guesses), key=problem.unexplained)
    enough = problem.unexplained(found) / REMAINING
    while nearer := [one for one in found.changes() if one.others < found.others]:
        costs = problem.fitted(nearer)[1]
        best = int(np.argmin(costs))
        if costs[best] > enough:
            yield found
        found = nearer[best]


def _told(problem: _Problem, found: Wiring) -> Rewired | None:
    """Another order, where it leaves much less, and less nearly everywhere.

    Less of a difference will do where the thrusters in question push about as the file says by that order and
    but little by the file's: late ones, which columns much alike imitate, push by their own.
    """
    plain = Wiring.plain(len(found.column))
    other = [one != own for one, own in zip(found.drives(), plain.drives(), strict=True)]
    here, there = problem.thrusts(found)[other], problem.thrusts(plain)[other]
    evident = bool((np.abs(here - 1.0) <= NEAR).all() and (there <= LITTLE).all())
    before, after = (
        np.array([each.sum() for each in np.array_split(problem.costs(one), BOOTSTRAP_STRETCHES)])
        for one in (plain, found)
    )
    gained = (PLAIN if evident else GROSS) * before - after
    if gained.sum() <= 0.0 or (before > after).mean() < MOSTLY:
        return None
    confidence = float((weights(BOOTSTRAP_STRETCHES, RESAMPLES, 0) @ gained > 0.0).mean())
    if confidence < LEAST_CONFIDENCE:  # all else would be told of columns that were in order
        return None
    return Rewired(found, float(after.sum() / before.sum()), confidence)


def _improved(problem: _Problem, begun: Wiring) -> Wiring:
    """The order after every exchange and reversal that explains more, the best first."""
    found, least = begun, problem.unexplained(begun)
    while True:
        changes = list(found.changes())
        costs = problem.fitted(changes)[1]
        best = int(np.argmin(costs))
        if costs[best] > REMAINING * least:
            return found
        found, least = changes[best], float(costs[best])


@dataclass(frozen=True)
class _Problem:
    """Accelerations over windows, less all that what is free meanwhile explains of them.

    Attributes:
        needed: What thrusts have to explain, (W, 6).
        answers: What each thruster, by each column and its reverse, makes of it, (n, n, 2, W, 6).
    """

    needed: Array
    answers: Array

    @classmethod
    def of(cls, left: Array, answers: Array, free_: Array) -> _Problem:
        """Take away what is free meanwhile.

        Args:
            left: What the file leaves unexplained, (W, 6).
            answers: What every column would do to every thruster, (n, n, 2, W, 6).
            free_: What explains accelerations anyway, (P, W, 6).
        """
        size = _unanswered(left, answers, free_)
        basis, _ = np.linalg.qr((free_ / size).reshape(len(free_), -1).T)

        def projected(values: Array) -> Array:
            flat = (values / size).reshape(*values.shape[:-2], -1)
            cut: Array = flat - flat @ basis @ basis.T
            return cut.reshape(values.shape)

        own = np.arange(len(answers))
        return cls(projected(left + answers[own, own, 0].sum(axis=0)), projected(answers))

    def unexplained(self, wiring: Wiring) -> float:
        """Sum of squares that an order of the columns leaves."""
        return float(self.fitted([wiring])[1][0])

    def costs(self, wiring: Wiring) -> Array:
        """The same of each window, (W,)."""
        made = np.tensordot(self.thrusts(wiring), self.answers[_places([wiring])][0], 1)
        costs: Array = ((self.needed - made) ** 2).sum(axis=1)
        return costs

    def thrusts(self, wiring: Wiring) -> Array:
        """Each thruster's, as a multiple of the file's, that explain most, (n,)."""
        found: Array = self.fitted([wiring])[0][0]
        return found

    def fitted(self, wirings: Sequence[Wiring]) -> tuple[Array, Array]:
        """The thrusts within THRUSTS that explain most by each of many orders, (B, n); what they leave, (B,).

        What does not show stays as in the file.
        """
        thruster, column, sign = _places(wirings)
        at = (thruster * len(self.answers) + column) * 2 + sign
        gram, score, whole = self._squares
        curved, slope = gram[at[:, :, None], at[:, None, :]], score[at]
        found = _within_bounds(curved, slope, NOTHING * max(float(gram.max()), NOTHING))
        left = whole - 2.0 * (found * slope).sum(axis=1) + np.einsum("bi,bik,bk->b", found, curved, found)
        return found, left

    @cached_property
    def _squares(self) -> tuple[Array, Array, float]:
        """Products of all answers with one another and with what is needed, and of this with itself."""
        every, needed = self.answers.reshape(-1, self.needed.size), self.needed.ravel()
        return every @ every.T, every @ needed, float(needed @ needed)


def _within_bounds(curved: Array, slope: Array, nothing: float) -> Array:
    """Thrusts (B, n) within THRUSTS that explain most, from the file's on.

    Least squares of bounded variables (Stark and Parker 1995): those that no bound holds go to where they
    explain most, or as far as the next bound; once there, the one that gains most is let go of its bound.

    Args:
        curved: Products of the answers to them with one another, (B, n, n),
        slope: and with what is needed, (B, n).
        nothing: Square of an answer that is none.
    """
    (low, high), count = THRUSTS, slope.shape[1]
    own = np.maximum(np.einsum("bii->bi", curved), nothing)
    found, arrived = np.ones(slope.shape), np.zeros(len(slope), bool)
    for _ in range(STEPS):
        uphill = slope - np.einsum("bik,bk->bi", curved, found)
        inside = (found > low) & (found < high)
        gain = np.where(inside, 0.0, np.where(found <= low, uphill, -uphill)) / np.sqrt(own)
        let_go = arrived[:, None] & (np.arange(count) == gain.argmax(axis=1)[:, None]) & (gain > 0.0)
        free = inside | let_go
        matrix = np.where(free[:, :, None] & free[:, None, :], curved, 0.0)
        matrix += np.where(free, RIDGE, 1.0)[:, :, None] * own[:, :, None] * np.eye(count)
        step = np.linalg.solve(matrix, np.where(free, uphill, 0.0)[..., None])[..., 0]
        room = np.where(step > 0.0, high - found, found - low)
        part = np.where(free, room / np.maximum(np.abs(step), NOTHING), np.inf)
        share = np.minimum(part.min(axis=1), 1.0)
        found = np.clip(found + step * share[:, None], low, high)
        found = np.where(part <= share[:, None], np.where(step > 0.0, high, low), found)
        if (arrived & ~let_go.any(axis=1)).all():
            break
        arrived = share == 1.0
    return found


def _places(wirings: Sequence[Wiring]) -> tuple[Rows, Rows, Rows]:
    """Where the answers of each thruster stand, by its number, column and sign, (B, n) each."""
    column = np.array([one.column for one in wirings])
    sign = (np.array([one.sign for one in wirings]) < 0).astype(np.int64)
    return np.broadcast_to(np.arange(column.shape[1]), column.shape), column, sign


def _answers(vehicle: Vehicle, windows: Windows) -> Array:
    """Whitened answer of the windows to each thruster driven by each column, and by its reverse."""
    record, table = windows.record, candidate(vehicle).thrusters
    count = record.commands.shape[1]
    pushed = table[:, UNIT_WRENCH] @ _accelerated(vehicle, windows)
    window = windows.rows[windows.starts[:, None] + np.arange(windows.test.size)]
    out = np.empty((count, count, 2, len(window), WRENCH))
    for turn, sign in product(range(count), (0, 1)):
        columns = (np.arange(count) + turn) % count
        commands = np.ascontiguousarray(record.commands[:, columns]) * (1.0 - 2.0 * sign)
        force = thrusts(table, commands, record.t, record.segments, after_gap=record.after_gap)
        summed = np.einsum("l,wli->iw", windows.test, force[window])
        out[np.arange(count), columns, sign] = windows.counted(summed[:, :, None] * pushed[:, None, :])
    return out


def _accelerated(vehicle: Vehicle, windows: Windows) -> Array:
    """What a unit of each wrench, from the right, does to the whitened accelerations, (6, 6)."""
    inverse = constants_of(candidate(vehicle).program.flat)[INVERSE_MASS_MATRIX:][:36].reshape(6, 6)
    return np.asarray(inverse.T @ windows.whitener[:WRENCH, :WRENCH].T)


def _summed(windows: Windows, accelerations: Array) -> Array:
    """The windows' answer to whitened accelerations at every row of the recording, (N, 6): (W, 6)."""
    window = windows.rows[windows.starts[:, None] + np.arange(windows.test.size)]
    return windows.counted(np.einsum("l,wli->wi", windows.test, accelerations[window]))


def _free(vehicle: Vehicle, windows: Windows) -> Array:
    """What explains accelerations anyway, (P, W, 6): a constant wrench, and effects that may be there."""
    own = own_effects(vehicle)
    unknown = free(vehicle, [*own, *(name for name in BESIDE if not vehicle.effects(name))])
    answers = windows.columns(vehicle, *moved(unknown, unknown.starts[0]))[:, :WRENCH, :-1]
    answers = np.moveaxis(answers, -1, 0)
    size = np.linalg.norm(answers, axis=(1, 2))
    constant = np.repeat(np.eye(WRENCH)[:, None], len(windows.starts), axis=1)
    return np.concatenate([constant, answers[size > 0.0] / size[size > 0.0, None, None]])


def _unanswered(left: Array, answers: Array, free_: Array) -> Array:
    """Size of what no thrusts explain whatever they push, axis by axis, (6,); at least the noise."""
    size = np.ones(WRENCH)
    for axis in range(WRENCH):
        pushed = answers[:, :, 0, :, axis].reshape(-1, len(left))
        columns = np.vstack([free_[:, :, axis], pushed]).T
        found = np.linalg.lstsq(columns, left[:, axis], rcond=1e-8)[0]
        size[axis] = max(float(np.sqrt(np.mean((left[:, axis] - columns @ found) ** 2))), 1.0)
    return size
