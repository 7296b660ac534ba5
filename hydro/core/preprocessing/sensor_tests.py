"""Errors of the velocity log, shown by kinematics alone.

Whatever forces act, d(position)/dt = R v (Fossen 2011, sec. 2.2).  Pose and logged velocity therefore show
each of the log's errors (`core.effects.sensor`) without any model of the dynamics, and no current or missing
force can be taken for one.  What is compared is the position less the integral of R v, both through the
high-pass that makes noise of the position and of the velocity white together: the Kalman filter of a position
that is measured with noise while its dead reckoning wanders.  Nothing noisy is ever differentiated.  What is
left beyond the noise counts as noise of the position: fixes that come more rarely than rows weigh less.

All thirteen numbers of the log are fitted at once.  So an effect is said to be there, or not to be there,
beside all others; where a recording does not tell two of them apart, neither shows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh
from scipy.special import chdtrc, fdtrc, ndtri

from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE
from hydro.core.effects.sensor import ANGLES, BIAS, DELAY, LEVER, LOG, SCALE
from hydro.core.errors import DataError
from hydro.core.prediction.normal_equations import Normal, block_length, covariance
from hydro.core.recording.arrays import Recording, noise
from hydro.core.vehicle.frames import rotation

ENTRIES = {
    name: (effect.kinematics.parameter, effect.kinematics.place)
    for name, effect in CATALOGUE.items()
    if effect.kinematics is not None
}
"""Parameter of each effect, and its place in the row that describes a velocity log."""

SHOWN = 1e-3
"""Probability of chance up to which an effect is shown."""
VETO = 1e-4
"""Probability of chance up to which a claim is refuted."""
SEEN = 0.9
"""Probability with which an error as large as `KinematicTest.visible` shows."""

HORIZON = (0.25, 20.0)  # s, bounds of the time over which dead reckoning is trusted
PIECE_SECONDS = 2.0  # s, of one piece of the normal equations
BOX = 0.1  # s, to each side, over which an acceleration is averaged
PLAIN_SIZE = 0.5  # of every parameter, in its own unit: what is not determined stays within
LATEST = 2.0  # s, of a delay
CAUTION = 0.9  # part of the shared noise that is taken off
LEAST_PIECES = 8
ITERATIONS = 8
REWEIGHTED = 4
RARE = 3.0  # times its noise from row to row: a position that was interpolated or held between fixes
ROUGH = 10.0  # times as large must an error be to show against such a position
OTHERWISE = 1.1  # residual over its noise from which the position's noise is made anew
SETTLED = 0.01  # standard errors
HELD = 1e15  # information of an entry that is held


@dataclass(frozen=True)
class KinematicTest:
    """What kinematics says of one error of the velocity log, beside all others.

    Attributes:
        effect: Name in the catalogue.
        estimate: Its parameters, (p,), in packing order.
        covariance: Theirs, (p, p), robust against correlated residuals.
        blocks: Independent stretches of data behind it.
        negligible: Size of an entry that does not matter.
        missed: By how much the squared residual is greater without it, all other errors fitted anew, in units
            of what is left; looked at only where the estimate shows.
    """

    effect: str
    estimate: Array
    covariance: Array
    blocks: int
    negligible: float
    missed: float = np.inf

    @property
    def standard_error(self) -> Array:
        """Of each entry, (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def visible(self) -> Array:
        """Size from which each entry alone would have shown nine times out of ten, (p,)."""
        size: Array = (ndtri(SEEN) - ndtri(0.5 * SHOWN)) * self.standard_error
        return np.maximum(size, self.negligible)

    @property
    def table(self) -> dict[str, Any]:
        """The estimate as an `[[effect]]` table."""
        name = ENTRIES[self.effect][0]
        number = CATALOGUE[self.effect].parameter(name).shape == ()
        value = float(self.estimate[0]) if number else self.estimate.tolist()
        return {"name": self.effect, name: value}

    @property
    def errors(self) -> dict[str, Any]:
        """The standard errors of `table`, by parameter."""
        name = ENTRIES[self.effect][0]
        number = CATALOGUE[self.effect].parameter(name).shape == ()
        return {name: float(self.standard_error[0]) if number else self.standard_error.tolist()}

    @property
    def p_value(self) -> float:
        """Probability that chance alone would show as much."""
        return self.chance(np.zeros_like(self.estimate))

    def distance(self, claimed: Array) -> float:
        """How far the estimate lies from claimed values, (p,), in squared standard errors (Wald)."""
        away = self.estimate - claimed
        return float(away @ np.linalg.solve(self.covariance, away))

    def chance(self, claimed: Array) -> float:
        """Probability that chance alone would put the estimate as far from claimed values."""
        entries = len(self.estimate)
        return float(fdtrc(entries, max(self.blocks - entries, 1), self.distance(claimed) / entries))


def shown(test: KinematicTest) -> bool:
    """Whether kinematics shows an effect clearly: by more than chance, and by more than does not matter."""
    size, error = test.estimate, test.standard_error
    if (size < CATALOGUE[test.effect].parameter(ENTRIES[test.effect][0]).low).any():
        return False  # what no log can have: the pose is late, not the log
    clear = np.abs(size) > test.negligible - ndtri(0.5 * SHOWN) * error
    return test.p_value <= SHOWN and bool(clear.any()) and _missed(test)


def _missed(test: KinematicTest) -> bool:
    """Whether a recording is explained worse without an effect than chance alone would make it.

    Where a log moves along one line alone, scales and angles may turn into one another: the estimate is far
    from nothing then and its linearised errors are small, and without it all fits as well.
    """
    return float(chdtrc(len(test.estimate), test.missed)) <= SHOWN


def vetoed(test: KinematicTest, claimed: Mapping[str, Any]) -> bool:
    """Whether kinematics contradicts the values that a model of the dynamics asks for.

    Args:
        test: Of the effect.
        claimed: Its `[[effect]]` table.

    Returns:
        True where the claim is refuted, and the estimate agrees better with no error than with this one.
        False where the recording could not have shown an error of that size.

    Raises:
        DataError: The table is none of this effect.
    """
    given = {key: value for key, value in claimed.items() if key != "standard_error"}
    values = CATALOGUE[test.effect].pack(given, thrusters=0)
    values = np.broadcast_to(values, test.estimate.shape)
    nearer_none = test.distance(np.zeros_like(values)) < test.distance(values)
    return nearer_none and test.chance(values) <= VETO


def kinematic_tests(record: Recording) -> dict[str, KinematicTest]:
    """Hold pose against velocity for all errors of the velocity log.

    Args:
        record: The recording.

    Returns:
        One test per sensor effect, by name; none where position, attitude or velocity has no samples, for one
        of them was then made of the others.

    Raises:
        DataError: The recording has fewer than eight stretches of two seconds without a gap.
    """
    if record.seen is not None and not record.seen[:, :9].any(axis=0).all():
        return {}
    given, log = noise(record), np.zeros(LOG)
    sigma = given.copy()
    for _ in range(REWEIGHTED + 1):
        log, spread, normal = _fitted(record, log, sigma)
        left = np.sqrt(normal.channels.sum(axis=0) / (normal.residuals / 3))
        if (left < OTHERWISE).all():
            break
        # A position known at longer intervals than it is logged errs by more than its rows tell.
        sigma[:3] *= np.maximum(left, 1.0)
    blocks = len(normal.gram) // block_length(normal.score)
    rough = ROUGH if (sigma[:3] > RARE * given[:3]).any() else 1.0
    tests = {}
    for name, (_, place) in ENTRIES.items():
        negligible = rough * _negligible(name, record.dt)
        test = KinematicTest(name, log[place], spread[place, place], blocks, negligible)
        if shown(test):
            without = _fitted(record, log, sigma, place)[2]
            test = replace(test, missed=(_squares(without) - _squares(normal)) / max(normal.chi2, 1.0))
        tests[name] = test
    return tests


def _squares(normal: Normal) -> float:
    """Sum of the squared residuals of a problem."""
    return float(normal.channels.sum())


def _negligible(effect: str, dt: float) -> float:
    """Size of an error that nobody would put right; half a sample where the record has none."""
    kinematics = CATALOGUE[effect].kinematics
    size = kinematics.negligible if kinematics is not None else None
    return 0.5 * dt if size is None else size


def _fitted(
    record: Recording, log: Array, sigma: Array, without: slice | int | None = None
) -> tuple[Array, Array, Normal]:
    """The log's best row (LOG,) by Gauss and Newton, its covariance, and the problem about it.

    Args:
        record: The recording.
        log: Where to begin.
        sigma: Noise of all channels (12,).
        without: Entries that are held at 0.
    """
    prior = np.full(LOG, PLAIN_SIZE**-2)
    if without is not None:
        log = log.copy()
        log[without], prior[without] = 0.0, HELD
    for _ in range(ITERATIONS):
        normal, biased = _problem(record, log, sigma)
        pull = normal.score.sum(axis=0) - prior * log
        step = np.linalg.solve(normal.matrix.sum(axis=0) + np.diag(prior), pull)
        spread = covariance(normal, prior) + np.diag(biased**2)
        log = log + step
        log[SCALE] = np.clip(log[SCALE], -0.9, None)
        log[DELAY] = np.clip(log[DELAY], -LATEST, LATEST)
        if (np.abs(step) < SETTLED * np.sqrt(np.diag(spread))).all():
            break
    return log, spread, normal


def _problem(record: Recording, log: Array, sigma: Array) -> tuple[Normal, Array]:
    """The least-squares problem about an estimate of the log, and by how much noise may bias it, (LOG,).

    Columns and residual share the noise of the velocity.  What that adds to their products is known, and
    taken off, short of leaving an axis without motion with less than nothing (Fuller 1987, sec. 2.5): without
    any one block of pieces, too, or a jackknife over them has no bounds.  What is left biases a scale or an
    angle by its share of the products: an axis that hardly moves seems to be read many times too large.
    """
    pieces = list(_pieces(record, log, sigma))
    if sum(len(gram) for gram, _, _ in pieces) < LEAST_PIECES:
        raise DataError(
            f"the recording has fewer than {LEAST_PIECES} stretches of {PIECE_SECONDS:g} s without a gap to "
            f"hold velocity against pose; record at least {LEAST_PIECES * PIECE_SECONDS:g} s"
        )
    gram, shared, squares = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    rows = 3 * round(PIECE_SECONDS / record.dt)

    def less(share: float) -> Normal:
        """The problem without so much of what noise adds."""
        return Normal(gram - share * shared, rows, squares, np.zeros((len(gram), 0, LOG + 1)))

    share = _spare(gram.sum(axis=0), shared.sum(axis=0))
    edges = np.arange(0, len(gram), block_length(less(CAUTION * share).score))
    left_out = (part.sum(axis=0) - np.add.reduceat(part, edges) for part in (gram, shared))
    share = CAUTION * min(share, *map(_spare, *left_out))
    noisy, whole = (np.diagonal(part.sum(axis=0))[:LOG] for part in (shared, gram))
    noise = (1.0 - share) * noisy
    least = np.maximum(
        noise / PLAIN_SIZE, np.finfo(float).tiny
    )  # an axis without motion is biased altogether
    return less(share), noise / np.maximum(whole - share * noisy, least)


def _spare(gram: Array, shared: Array) -> float:
    """Share of what noise adds, at most all of it, that some pieces have to spare.

    More, and they would tell less than nothing of a scale or an angle beside the log's other numbers.
    """
    mount = np.arange(SCALE.start, ANGLES.stop)
    others = np.setdiff1d(np.arange(LOG), mount)
    known = gram[np.ix_(others, others)] + PLAIN_SIZE**-2 * np.eye(len(others))
    both = gram[np.ix_(others, mount)]
    told = gram[np.ix_(mount, mount)] - both.T @ np.linalg.solve(known, both)
    least = eigh(told, shared[np.ix_(mount, mount)], eigvals_only=True)[0]
    return float(np.clip(least, 0.0, 1.0))


def _pieces(record: Recording, log: Array, sigma: Array) -> Iterator[tuple[Array, Array, Array]]:
    """Gram matrices of [columns, residual], what noise adds to them, and squares by axis; per segment."""
    dt, mount, turned = record.dt, _mount(log), _mount_derivatives(log)
    wander = np.sqrt((sigma[6:9] ** 2).mean())
    horizon = np.clip(sigma[:3] / wander, *HORIZON)
    keep = np.exp(-dt / horizon)
    # Variance of the filtered noise: of the position, and of the velocity summed up by trapezoids.
    summed = 0.5 * dt**2 / (1.0 - keep)
    weight = 1.0 / np.sqrt(sigma[:3] ** 2 * 2.0 / (1.0 + keep) + wander**2 * summed)
    noisy = np.concatenate([turned, -mount[None]])
    shared = np.einsum("jab,b,kcb->jkac", noisy, sigma[6:9] ** 2, noisy)
    shared[-1, -1] = 0.0
    length, late = max(round(PIECE_SECONDS / dt), 4), round((abs(log[DELAY]) + BOX) / dt)
    for start, stop in record.segments:
        count = (stop - start - 2 * late) // length
        if count < 1:
            continue
        eta, nu = record.eta[start:stop], record.nu[start:stop]
        R = rotation(*eta[:, 3:].T)
        velocity, columns = _reading(log, mount, turned, nu, record.t[start:stop])
        moved = np.concatenate([columns, velocity[None]])
        along = (R @ moved.transpose(1, 2, 0)).transpose(1, 0, 2)  # (3, rows, LOG + 1)
        both = np.empty_like(along)
        for i in range(3):
            high_pass = [1.0, -keep[i]]
            both[i] = weight[i] * scipy.signal.lfilter([0.5 * dt, 0.5 * dt], high_pass, along[i], axis=0)
            placed = scipy.signal.lfilter([1.0, -1.0], high_pass, eta[:, i] - eta[0, i])
            both[i, :, -1] = weight[i] * placed - both[i, :, -1]
        cut = both[:, late : late + count * length].reshape(3, count, length, LOG + 1)
        gram = np.einsum("ipka,ipkb->pab", cut, cut, optimize=True)
        turns = R[late : late + count * length].reshape(count, length, 3, 3)
        trace = np.einsum("i,pkia,pkic->pac", weight**2 * summed, turns, turns, optimize=True)
        yield (
            gram,
            np.einsum("pac,jkac->pjk", trace, shared, optimize=True),
            (cut[..., -1] ** 2).sum(axis=2).T,
        )


def _mount(log: Array) -> Array:
    """Matrix (3, 3) from the log's reading without its bias to the velocity at the log, body axes."""
    matrix: Array = rotation(*log[ANGLES]) / (1.0 + log[SCALE])
    return matrix


def _mount_derivatives(log: Array) -> Array:
    """Derivatives of `_mount` by all entries of the log, (LOG, 3, 3)."""
    little, out = 1e-5, np.zeros((LOG, 3, 3))
    for i in [*range(LOG)[SCALE], *range(LOG)[ANGLES]]:
        shift = little * np.eye(LOG)[i]
        out[i] = (_mount(log + shift) - _mount(log - shift)) / (2.0 * little)
    return out


def _reading(log: Array, mount: Array, turned: Array, nu: Array, t: Array) -> tuple[Array, Array]:
    """Velocity of CO behind a reading, (N, 3), and its derivatives by the entries of the log, (LOG, N, 3)."""
    path = CubicSpline(t, nu[:, :3])
    now, before, after = (path(np.clip(t + log[DELAY] + shift, t[0], t[-1])) for shift in (0.0, -BOX, BOX))
    now -= log[BIAS]
    columns = now @ turned.transpose(0, 2, 1)
    columns[DELAY] = (after - before) @ mount.T / (2.0 * BOX)
    columns[LEVER] = -np.cross(nu[:, 3:], np.eye(3)[:, None])
    columns[BIAS] = -mount.T[:, None]
    return now @ mount.T - np.cross(nu[:, 3:], log[LEVER]), columns
