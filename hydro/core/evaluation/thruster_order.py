"""Does each command column drive the thruster of its number?  Columns exchanged or reversed, by force alone.

A column that belongs to another thruster pushes where the file does not expect it, and no effect does that:
added mass and damping bend until they fit best.  So before any effect is thought of, the accelerations of the
recording (equation error, `identification.weak_form`) are held against every exchange of two columns and
every reversal. A constant wrench, all that the file's own effects could be otherwise, and whatever part of
its thrust each thruster may lack are free meanwhile, so that a worn or dead thruster is none of this.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from scipy.optimize import lsq_linear

from hydro.core.columns import Array, command_column
from hydro.core.effects.catalogue import own_effects, with_role
from hydro.core.effects.layout import INVERSE_MASS_MATRIX
from hydro.core.effects.program import constants_of
from hydro.core.effects.record import Role
from hydro.core.evaluation.block_resampling import weights
from hydro.core.identification.candidate import candidate
from hydro.core.identification.parameters import free
from hydro.core.identification.weak_form import Windows
from hydro.core.recording.arrays import Recording
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import UNIT_WRENCH, thrusts

MOST_WINDOWS = 200
"""Windows that are looked at, spread evenly."""
LEAST_WINDOWS, SHORTEST = 24, 5.0
"""Windows, and length of the longest piece without a gap [s], that tell anything."""
GROSS = 0.5
"""Part of what the accelerations leave unexplained that another order of the columns must explain."""
MOSTLY = 0.75
"""Part of the recording's stretches in which it must do so."""
BESIDE = with_role(Role.OFTEN_LACKING)
"""Effects that a file often lacks, so that they do not hide an exchange."""
REMAINING = 0.95
"""Part of what is left that one more exchange or reversal may leave at most."""
REVERSED = 0.85
"""The same for one thruster in reverse, which is a plainer thing: a dead thruster leaves it where it is."""
NEAR = 0.5
"""Relative deviation that the thrust of a thruster in reverse may have of the file's."""
GAINS = (-1.0, 0.5)
"""Relative deviations of a thrust that are no matter of its column: from dead to half as much again."""
BOOTSTRAP_STRETCHES, RESAMPLES = 20, 1000
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
        both = [changed.get(i, pair) for i, pair in enumerate(zip(self.column, self.sign, strict=True))]
        return Wiring(tuple(c for c, _ in both), tuple(s for _, s in both))

    def apply(self, commands: Array) -> Array:
        """Commands (N, n) in the order and with the signs that the file means."""
        return np.ascontiguousarray(commands[:, list(self.column)] * np.array(self.sign, float))

    def columns(self) -> tuple[str, ...]:
        """Columns that do not drive the thruster of their number, or drive it in reverse."""
        drives = enumerate(zip(self.column, self.sign, strict=True))
        return tuple(
            sorted(command_column(column) for i, (column, sign) in drives if (column, sign) != (i, 1))
        )

    def words(self) -> str:
        """What is other than the file says: `cmd_2 drives thruster 1`."""
        changed = [
            f"{'minus ' if sign < 0 else ''}cmd_{column + 1} drives thruster {i + 1}"
            for i, (column, sign) in enumerate(zip(self.column, self.sign, strict=True))
            if (column, sign) != (i, 1)
        ]
        return ", ".join(changed)


@dataclass(frozen=True)
class Rewired:
    """Another order of the columns that explains the accelerations far better.

    Attributes:
        wiring: It.
        left: Part of what the file's order leaves unexplained that this one leaves.
        confidence: Part of the resampled recordings in which that is less than GROSS.
    """

    wiring: Wiring
    left: float
    confidence: float


def rewired(vehicle: Vehicle, record: Recording, *, one_reversed: bool = False) -> Rewired | None:
    """The order of the command columns that the accelerations ask for.

    Args:
        vehicle: The vehicle.
        record: The recording.
        one_reversed: Also where it is one thruster that turns in reverse and less speaks for it: more than
            for a dead one, though, and with about the thrust of the file.

    Returns:
        None where the file's is as good, or the recording too short to tell or blind on an axis.
    """
    count, longest = record.commands.shape[1], np.diff(record.segments, axis=1).max()
    if not count or longest * record.dt < SHORTEST:
        return None
    windows = Windows.of(record, most=MOST_WINDOWS)
    if len(windows.starts) < LEAST_WINDOWS or not windows.shown.all():
        return None
    problem = _Problem.of(vehicle, windows)
    plain = Wiring.plain(count)
    found = min((_improved(problem, begun) for begun in plain.guesses()), key=problem.unexplained)
    other = None if found == plain else _told(problem, found, GROSS, GROSS)
    return other if other is not None or not one_reversed else _one_reversed(problem)


def _one_reversed(problem: _Problem) -> Rewired | None:
    """The reversal of one thruster that leaves the least, if it leaves enough less."""
    plain = Wiring.plain(len(problem.answers))
    single = [plain._with({i: (i, -1)}) for i in range(len(problem.answers))]
    best = min(range(len(single)), key=lambda i: problem.costs(single[i]).sum())
    if abs(problem.gains(single[best])[best]) > NEAR:  # of a dead one it is -1
        return None
    return _told(problem, single[best], REVERSED, 1.0)


def _told(problem: _Problem, found: Wiring, part: float, each_part: float) -> Rewired | None:
    """Another order, where it leaves less than a part of what the file's leaves, in most stretches, too."""
    before, after = (
        np.array([each.sum() for each in np.array_split(problem.costs(one), BOOTSTRAP_STRETCHES)])
        for one in (Wiring.plain(len(problem.answers)), found)
    )
    gained = part * before - after
    if gained.sum() <= 0.0 or (each_part * before > after).mean() < MOSTLY:
        return None
    confidence = float((weights(BOOTSTRAP_STRETCHES, RESAMPLES, 0) @ gained > 0.0).mean())
    return Rewired(found, float(after.sum() / before.sum()), confidence)


def _improved(problem: _Problem, begun: Wiring) -> Wiring:
    """The order after every exchange and reversal that explains more, the best first."""
    found, least = begun, problem.unexplained(begun)
    while True:
        best = min(found.changes(), key=problem.unexplained)
        if (cost := problem.unexplained(best)) > REMAINING * least:
            return found
        found, least = best, cost


@dataclass(frozen=True)
class _Problem:
    """Accelerations over windows, less all that what is free meanwhile explains of them.

    Attributes:
        left: What the file leaves unexplained, (W, 6).
        answers: What each thruster, by each column and its reverse, makes of it, (n, n, 2, W, 6).
    """

    left: Array
    answers: Array

    @classmethod
    def of(cls, vehicle: Vehicle, windows: Windows) -> _Problem:
        """Work out what every column would do to every thruster."""
        left, answers = windows.residuals(vehicle)[:, :WRENCH], _answers(vehicle, windows)
        free_ = _free(vehicle, windows)
        size = _unanswered(left, answers, free_)
        basis, _ = np.linalg.qr((free_ / size).reshape(len(free_), -1).T)

        def projected(values: Array) -> Array:
            flat = (values / size).reshape(*values.shape[:-2], -1)
            cut: Array = flat - flat @ basis @ basis.T
            return cut.reshape(values.shape)

        return cls(projected(left), projected(answers))

    def unexplained(self, wiring: Wiring) -> float:
        """Sum of squares that an order of the columns leaves."""
        return float((self._residual(wiring) ** 2).sum())

    def costs(self, wiring: Wiring) -> Array:
        """The same of each window, (W,), with the best gains of the thrusters that GAINS allows."""
        driven = np.stack(list(self._driven(wiring)))
        left = self._residual(wiring) - np.tensordot(self.gains(wiring), driven, 1)
        costs: Array = (left**2).sum(axis=1)
        return costs

    def gains(self, wiring: Wiring) -> Array:
        """Relative deviations of the thrusts that explain most, (n,)."""
        driven = np.stack(list(self._driven(wiring)))
        residual = self._residual(wiring).ravel()
        fitted: Array = lsq_linear(driven.reshape(len(driven), -1).T, residual, GAINS).x
        return fitted

    def _driven(self, wiring: Wiring) -> Iterator[Array]:
        for i, (column, sign) in enumerate(zip(wiring.column, wiring.sign, strict=True)):
            yield self.answers[i, column, int(sign < 0)]

    def _residual(self, wiring: Wiring) -> Array:
        left = self.left.copy()
        for new, old in zip(self._driven(wiring), self._driven(Wiring.plain(len(self.answers))), strict=True):
            left -= new - old
        return left


def _answers(vehicle: Vehicle, windows: Windows) -> Array:
    """Whitened answer of the windows to each thruster driven by each column, and by its reverse."""
    model, record = candidate(vehicle), windows.record
    table, count = model.thrusters, record.commands.shape[1]
    inverse = constants_of(model.program.flat)[INVERSE_MASS_MATRIX:][:36].reshape(6, 6)
    pushed = table[:, UNIT_WRENCH] @ inverse.T @ windows.whitener[:WRENCH, :WRENCH].T
    window = windows.rows[windows.starts[:, None] + np.arange(windows.test.size)]
    out = np.empty((count, count, 2, len(window), WRENCH))
    for turn, sign in product(range(count), (0, 1)):
        columns = (np.arange(count) + turn) % count
        commands = np.ascontiguousarray(record.commands[:, columns]) * (1.0 - 2.0 * sign)
        force = thrusts(table, commands, record.t, record.segments, after_gap=record.after_gap)
        summed = np.einsum("l,wli->iw", windows.test, force[window])
        out[np.arange(count), columns, sign] = windows.counted(summed[:, :, None] * pushed[:, None, :])
    return out


def _free(vehicle: Vehicle, windows: Windows) -> Array:
    """What explains accelerations anyway, (P, W, 6): a constant wrench, and effects that may be there."""
    own = own_effects(vehicle)
    unknown = free(vehicle, [*own, *(name for name in BESIDE if not vehicle.effects(name))])
    steps = np.array([entry.step for entry in unknown.entries])
    moved = [unknown.at(values) for values in unknown.starts[0] + np.diag(steps)]
    answers = np.moveaxis(windows.columns(vehicle, moved, steps.tolist())[:, :WRENCH, :-1], -1, 0)
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
