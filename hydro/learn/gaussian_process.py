"""A Gaussian process of a hull's wrench from labels: for minutes of data, of which networks make little.

Each axis is a sum of independent processes: a linear one, products of velocities and radial functions of the
direction of motion, that grow as the first to third power of the speed (`core.residual.mirrors`), once as the
mirrors of the hull have them and once as they have not. How large each is, and with them how drag grows with
the speed and how far the hull is from symmetric, is chosen by the error of folds of the data left out; so are
the centre of the mirrors and the arms that make velocities of rates. Nothing but the labels is known.
A second process is steered by the drag that the first predicts, on the axes where folds left out gain by it.

The mean of the process is then kept on some of the rows, by the projected process (Rasmussen and Williams
2006, section 8.3.4), as weights of `learn.networks.gaussian_process`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.optimize import minimize

from hydro.core.columns import Array, Rows
from hydro.core.residual.mirrors import (
    AXES,
    EPSILON,
    MIRRORS,
    PORT,
    POWERS,
    PRODUCTS,
    SIGNED,
    STAGES,
    SUMS,
    WIDTH,
    parities,
    products,
)
from hydro.core.residual.mirrors import TINY as SMALLEST

ROWS_WEIGHED = 900  # on which the processes are weighed
ROWS_EXPLORED = 450  # on which centre and arms are looked for
ROWS_LEARNT = 4500  # that teach the mean
FOLDS = 60
USUAL = 0.9  # share of the rows that are slower than 1 in units of the process
ARM = 0.5  # m, to begin with
ROUNDS = 2  # of looking for centre and arms, each with half the steps of the one before
STEPS = 25  # of the search for the variances of an axis
STIFFNESS = 5e-3  # what a variance e times its guess must win of the logarithm of the error
TINY = 1e-6  # of the label's square: a fold cannot do better
JITTER = 1e-9
STEERING = 1.0  # variance of what turns drag by its own direction
BOUNDS = (-16.0, 7.0)  # of the logarithms of variances

GUESSES = np.log(
    [
        *(1.0, 0.1, 1.0, 1.0),  # linear, and products of each power, as the mirrors have them
        *(0.03, 0.1, 1.0),  # radial functions of each power, likewise
        *(0.002, 0.006, 0.06),  # those of port and starboard
        *(0.0001, 0.0003, 0.003),  # those without any mirror
        *(0.01, 0.001, 0.001, 0.001),  # linear and products as no mirror has them
        *(1e-4, 1e-4),  # errors of the label that grow as m^3, and that do not
    ]
)
"""Logarithms of variances to begin with, in units of the label's mean square."""
PRODUCTS_AT, OTHERS_AT = 2, 15
"""Which of them are of products at p = 2, as the mirrors have them and as they have not."""


class Motion(NamedTuple):
    """Motions about the centre: z (N, 6), its size (N,), direction (N, 6), and products (N, 57)."""

    z: Array
    size: Array
    direction: Array
    products: Array


class Hull(NamedTuple):
    """The centre of the mirrors [m] (3,), and the scale of velocities (6,)."""

    centre: Array
    scale: Array

    def motion(self, nu: Array) -> Motion:
        """Motions of velocities (N, 6)."""
        z = np.hstack([nu[:, :3] + np.cross(nu[:, 3:], self.centre), nu[:, 3:]]) * self.scale
        size = np.sqrt((z**2).sum(axis=1) + EPSILON**2)
        direction = z / size[:, None]
        return Motion(z, size, direction, products(direction))

    def about(self, tau: Array) -> Array:
        """Wrenches (N, 6) about the centre, of those about CO."""
        return np.hstack([tau[:, :3], tau[:, 3:] - np.cross(self.centre, tau[:, :3])])


class Fit(NamedTuple):
    """What was found.

    Attributes:
        tensors: Of the network.
        left_out_rmse: Root mean square error over rows of folds left out and all axes, in N and N m mixed.
    """

    tensors: dict[str, NDArray[np.float32]]
    left_out_rmse: float


def fit(
    nu: Array,
    tau: Array,
    blocks: Sequence[str],
    *,
    points: int,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> Fit:
    """Find the process and its mean.

    Args:
        nu: Velocities (N, 6) [m/s, rad/s].
        tau: Labels (N, 6) [N, N m].
        blocks: Block of each row, two or more; rows of a block stand together.
        points: Rows to keep the mean on, at most N.
        seed: Of the choice of rows.
        progress: Called with the steps done, and how many there are.
    """
    draw = np.random.default_rng(seed)
    fold = _folds(blocks)
    told = progress or (lambda done, of: None)
    some = _some(draw, len(nu), ROWS_EXPLORED)
    hull = _explored(nu[some], tau[some], fold[some])
    told(1, 2 + AXES)
    some = _some(draw, len(nu), ROWS_WEIGHED)
    motion, labels = hull.motion(nu[some]), hull.about(tau[some])
    unit = np.sqrt((labels**2).mean(axis=0))
    unit[unit == 0.0] = 1.0
    found, left_out = [], []
    images = _images(motion, motion)
    for axis in range(AXES):
        parts = _parts(motion, motion, images, axis)
        logs = _weighed(parts, motion, labels[:, axis] / unit[axis], fold[some])
        found.append(logs)
        left_out.append(_left_out(_process(parts, motion, logs), labels[:, axis] / unit[axis], fold[some]))
        told(2 + axis, 2 + AXES)
    seen, unseen = (
        _directed(unit * np.stack(drags, axis=1)) / unit[:, None]
        for drags in ([one.fitted for one in left_out], [one.drag for one in left_out])
    )
    steered = []
    for axis, logs in enumerate(found):
        process = _process(_parts(motion, motion, images, axis), motion, logs, seen[:, axis])
        other = unseen[:, axis] - seen[:, axis]
        again = _left_out(process, labels[:, axis] / unit[axis], fold[some], (seen[:, axis], other))
        steered.append(_by_fold(again.missed, fold[some]) < _by_fold(left_out[axis].missed, fold[some]))
        left_out[axis] = again if steered[-1] else left_out[axis]
    many = _some(draw, len(nu), ROWS_LEARNT)
    kept = hull.motion(nu[np.sort(draw.permutation(len(nu))[:points])])
    known = hull.about(tau[many]) / unit
    tensors = _mean(hull.motion(nu[many]), known, kept, found, unit, steered)
    tensors |= {"centre": hull.centre, "scale": hull.scale, "top": np.array([hull.motion(nu).size.max()])}
    told(2 + AXES, 2 + AXES)
    stored = {name: value.astype(np.float32) for name, value in tensors.items()}
    missed = unit * np.stack([one.missed for one in left_out], axis=1)
    return Fit(stored, float(np.sqrt((missed**2).mean())))


def _folds(blocks: Sequence[str]) -> Rows:
    """Number of the fold of each row: blocks, or neighbouring blocks together where there are many."""
    names = np.asarray(blocks)
    block = np.concatenate([[0], np.cumsum(names[1:] != names[:-1])])
    return np.asarray(block // -(-(int(block[-1]) + 1) // FOLDS), dtype=np.int64)


def _some(draw: np.random.Generator, count: int, most: int) -> Rows:
    """Every so many-th of some rows, at most so many."""
    step = -(-count // most)
    return np.arange(int(draw.integers(step)), count, step)


def _images(one: Motion, other: Motion) -> Array:
    """R(g d, d'), (8, N, M)."""
    far = (one.direction**2).sum(axis=1)[:, None] + (other.direction**2).sum(axis=1)
    apart = np.stack([far - 2.0 * (one.direction * g) @ other.direction.T for g in MIRRORS])
    r = np.sqrt(3.0 * np.maximum(apart, 0.0)) / WIDTH
    return np.asarray((1.0 + r) * np.exp(-r))


def _sums(images: Array, axis: int) -> list[Array]:
    """The sums S of `core.residual.mirrors`, (N, M) each."""
    sign = MIRRORS[:, axis]
    return [np.tensordot(sign, images, 1) / 8.0, 0.5 * (images[0] + sign[PORT] * images[PORT]), images[0]]


def _mirrored(axis: int) -> NDArray[np.bool_]:
    """Which of z and its products an axis has on a hull with three planes of symmetry, (63,)."""
    return np.asarray((parities() == MIRRORS[:, [axis]]).all(axis=0))


def _parts(one: Motion, other: Motion, images: Array, axis: int) -> list[Array]:
    """Covariances of the processes, (N, M) each, in the order of GUESSES; then of the two that are no drag.

    These are the d_i d_j at p = 2, as the mirrors have them and as they have not, parts of two before.
    """
    own = _mirrored(axis)
    grown = [np.outer(one.size**p, other.size**p) for p in range(1, POWERS + 1)]

    def polynomial(chosen: NDArray[np.bool_]) -> list[Array]:
        line, product = chosen[:AXES], chosen[AXES:]
        together = one.products[:, product] @ other.products[:, product].T
        return [one.z[:, line] @ other.z[:, line].T, *(together * power for power in grown)]

    def even(chosen: NDArray[np.bool_]) -> Array:
        product = chosen & (np.arange(len(chosen)) >= AXES + SIGNED)
        together = one.products[:, product[AXES:]] @ other.products[:, product[AXES:]].T
        return np.asarray(together * grown[1])

    radial = [part * power for part in _sums(images, axis) for power in grown]
    return [*polynomial(own), *radial, *polynomial(~own), even(own), even(~own)]


def _noise(motion: Motion, logs: Array) -> Array:
    """Variance of the label's error (N,)."""
    return np.asarray(np.exp(logs[-2]) * motion.size ** (2 * POWERS) + np.exp(logs[-1]))


def _explored(nu: Array, tau: Array, fold: Rows) -> Hull:
    """Centre and arms that leave the least error of folds left out, by a search along the axes."""
    place = np.concatenate([np.zeros(3), np.log(np.full(3, ARM))])
    steps = np.array([0.1 * ARM] * 3 + [np.log(2.0)] * 3)
    best, cost = _hull(nu, place), _cost(_hull(nu, place), nu, tau, fold)
    for turn in range(ROUNDS):
        for number in (3, 4, 5, 2, 0, 1):
            for sign in (1.0, -1.0):
                tried = place.copy()
                tried[number] += sign * steps[number] / 2**turn
                hull = _hull(nu, tried)
                if (now := _cost(hull, nu, tau, fold)) < cost:
                    place, best, cost = tried, hull, now
                    break
    return best


def _hull(nu: Array, place: Array) -> Hull:
    """The hull of a centre and the logarithms of arms about x, y, z, in units of the usual motion."""
    scale = np.concatenate([np.ones(3), np.exp(place[3:])])
    usual = float(np.quantile(Hull(place[:3], scale).motion(nu).size, USUAL))
    return Hull(place[:3], scale / usual)


def _cost(hull: Hull, nu: Array, tau: Array, fold: Rows) -> float:
    """Mean over axes of the logarithm of the error of folds left out, with the variances of GUESSES."""
    motion, labels = hull.motion(nu), hull.about(tau)
    images = _images(motion, motion)
    total = 0.0
    for axis in range(AXES):
        label = labels[:, axis] / max(float(np.sqrt((tau[:, axis] ** 2).mean())), 1e-300)
        process = _process(_parts(motion, motion, images, axis), motion, GUESSES)
        total += float(np.log(_by_fold(_left_out(process, label, fold).missed, fold)))
    return total / AXES


class Process(NamedTuple):
    """Of one axis.

    Attributes:
        whole: Covariance with that of the label's error, (N, N).
        even: Covariance of what is no drag, d_i d_j at p = 2.
        noise: Variance of the label's error (N,).
    """

    whole: Array
    even: Array
    noise: Array


class LeftOut(NamedTuple):
    """What the mean says of rows whose fold was left out, (N,) each.

    Attributes:
        missed: What it misses of the label.
        drag: The drag that it predicts.
        fitted: The drag that it has where nothing was left out.
    """

    missed: Array
    drag: Array
    fitted: Array


def _process(parts: Sequence[Array], motion: Motion, logs: Array, steering: Array | None = None) -> Process:
    """The process with these logarithms of variances, steered by the columns (N, 3) if given."""
    *parts, even, other = parts
    variances, noise = np.exp(logs), _noise(motion, logs)
    whole = np.asarray(sum(v * part for v, part in zip(variances, parts, strict=False))) + np.diag(noise)
    if steering is not None:
        whole += STEERING * steering @ steering.T
    return Process(whole, variances[PRODUCTS_AT] * even + variances[OTHERS_AT] * other, noise)


def _left_out(
    process: Process, label: Array, fold: Rows, steering: tuple[Array, Array] | None = None
) -> LeftOut:
    """What the mean of a process says of every fold without its labels (N,).

    Args:
        process: Of an axis.
        label: In units of the process.
        fold: Of each row.
        steering: Its columns (N, 3), and how much else they are in a row whose fold the drag has not seen.
    """
    inverse = np.linalg.inv(process.whole)
    known = inverse @ label
    missed, even = np.empty_like(label), np.empty_like(label)
    for number in np.unique(fold):
        rows = np.flatnonzero(fold == number)
        missed[rows] = np.linalg.solve(inverse[np.ix_(rows, rows)], known[rows])
        without = known - inverse[:, rows] @ missed[rows]
        even[rows] = process.even[rows] @ without
        if steering is not None:
            missed[rows] -= STEERING * steering[1][rows] @ (steering[0].T @ without)
    fitted = label - process.noise * known - process.even @ known
    return LeftOut(missed, label - missed - even, fitted)


def _by_fold(missed: Array, fold: Rows) -> float:
    """Mean over folds of the root mean square of what was missed (N,)."""
    squares = np.bincount(fold - fold.min(), missed**2) / np.maximum(np.bincount(fold - fold.min()), 1)
    return float(np.sqrt(squares[np.unique(fold) - fold.min()] + TINY).mean())


def _directed(drag: Array) -> Array:
    """F_i |F_j| / |F| of drag (N, 6), over the forces or over the moments, (N, 6, 3)."""
    halves = drag.reshape(-1, 2, 3)
    size = np.maximum(np.sqrt((halves**2).sum(axis=2)), SMALLEST)
    made = halves[:, :, :, None] * np.abs(halves)[:, :, None, :] / size[:, :, None, None]
    return np.asarray(made.reshape(-1, AXES, 3))


def _weighed(parts: list[Array], motion: Motion, label: Array, fold: Rows) -> Array:
    """Logarithms of the variances that leave the least error of folds left out."""
    covariances = [torch.from_numpy(part) for part in parts[:-2]]
    guesses, truth = torch.from_numpy(GUESSES), torch.from_numpy(label)
    growth = torch.from_numpy(motion.size ** (2 * POWERS))
    where = [torch.from_numpy(np.flatnonzero(fold == number)) for number in np.unique(fold)]

    def missed(logs: torch.Tensor) -> list[torch.Tensor]:
        variances = torch.exp(logs)
        K = sum((v * part for v, part in zip(variances, covariances, strict=False)), torch.zeros(()))
        inverse = torch.linalg.inv(K + torch.diag(variances[-2] * growth + variances[-1]))
        known = inverse @ truth
        return [torch.linalg.solve(inverse[rows][:, rows], known[rows]) for rows in where]

    def cost(values: Array) -> tuple[float, Array]:
        logs = torch.tensor(values, requires_grad=True)
        error = torch.stack([torch.sqrt(one.square().mean() + TINY) for one in missed(logs)]).mean()
        total = torch.log(error) + STIFFNESS * (logs - guesses).square().sum()
        torch.autograd.backward(total)
        assert logs.grad is not None
        return float(total.detach()), logs.grad.numpy()

    limits = [BOUNDS] * len(GUESSES)
    options = {"maxiter": STEPS, "maxfun": STEPS + 10}
    found = minimize(cost, GUESSES, jac=True, method="L-BFGS-B", bounds=limits, options=options)
    return np.asarray(found.x)


def _mean(
    motion: Motion, labels: Array, kept: Motion, found: Sequence[Array], unit: Array, steered: Sequence[bool]
) -> dict[str, Array]:
    """The mean of both stages on points, as tensors of the network; labels (N, 6) are in their units (6,)."""
    linear = np.zeros((STAGES, AXES, AXES))
    library = np.zeros((STAGES, POWERS, PRODUCTS, AXES))
    radial = np.zeros((len(kept.size), STAGES, SUMS, POWERS, AXES))
    steering, drag = np.zeros((AXES, 3)), np.empty_like(labels)
    across, within = _images(motion, kept), _images(kept, kept)
    for stage in range(STAGES):
        for axis, logs in enumerate(found):
            parts, square = _parts(motion, kept, across, axis), _parts(kept, kept, within, axis)
            columns = sum(v * part for v, part in zip(np.exp(logs), parts[:-2], strict=False))
            prior = sum(v * part for v, part in zip(np.exp(logs), square[:-2], strict=False))
            columns, prior = np.asarray(columns), np.asarray(prior)
            if stage and steered[axis]:
                columns = np.hstack([columns, _directed(unit * drag)[:, axis] / unit[axis]])
                prior = block_diag(prior, np.eye(3) / STEERING)
            alpha = _solved(columns, prior, labels[:, axis], _noise(motion, logs))
            on_points = alpha[: len(kept.size)]
            if not stage:
                even = np.exp(logs[PRODUCTS_AT]) * parts[-2] + np.exp(logs[OTHERS_AT]) * parts[-1]
                drag[:, axis] = columns @ alpha - even @ on_points
            elif steered[axis]:
                steering[axis] = alpha[len(kept.size) :]
            folded = _folded(kept, unit[axis] * on_points, np.exp(logs), axis)
            linear[stage, axis], library[stage, :, :, axis], radial[:, stage, :, :, axis] = folded
    return {
        "steering": steering,
        "linear": linear,
        "library": library,
        "points": kept.direction,
        "weights": radial,
    }


def _solved(columns: Array, prior: Array, label: Array, noise: Array) -> Array:
    """Weights of columns (N, K), of this inverse variance, that explain labels (N,) with errors."""
    sure = columns.T / noise
    normal = sure @ columns + prior
    normal += JITTER * np.trace(normal) / len(normal) * np.eye(len(normal))
    return np.asarray(np.linalg.solve(normal, sure @ label))


def _folded(kept: Motion, alpha: Array, variances: Array, axis: int) -> tuple[Array, Array, Array]:
    """Weights alpha (K,) of the rows kept as those of z (6,), products (3, 57), and points (K, 3, 3)."""
    own, rest = _mirrored(axis), variances[OTHERS_AT - 2 :]
    grown = kept.size ** np.arange(1, POWERS + 1)[:, None] * alpha
    linear = np.where(own[:AXES], variances[0], rest[0]) * (kept.z.T @ alpha)
    sizes = np.where(own[AXES:], variances[1 : 1 + POWERS, None], rest[1 : 1 + POWERS, None])
    radial = variances[1 + POWERS : 1 + POWERS * (1 + SUMS)].reshape(SUMS, POWERS)
    return linear, sizes * (grown @ kept.products), np.einsum("sp,pk->ksp", radial, grown)
