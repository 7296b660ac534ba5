"""A Gaussian process of a hull's wrench from labels: for minutes of data, of which networks make little.

Each axis is a sum of independent processes: a linear one, products of velocities and radial functions of the
direction of motion, that grow as the first to third power of the speed (`core.residual.mirrors`), once as the
mirrors of the hull have them and once as they have not. How large each is, and with them how drag grows with
the speed and how far the hull is from symmetric, is chosen by the error of folds of the data left out; so are
the centre of the mirrors and the arms that make velocities of rates. Nothing but the labels is known.

The mean of the process is then kept on some of the rows, by the projected process (Rasmussen and Williams
2006, section 8.3.4), as weights of `learn.networks.gaussian_process`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize

from hydro.core.columns import Array, Rows
from hydro.core.residual.mirrors import (
    AXES,
    EPSILON,
    MIRRORS,
    PORT,
    POWERS,
    WIDE,
    parities,
    products,
)

ROWS_WEIGHED = 900  # on which the processes are weighed
ROWS_EXPLORED = 450  # on which centre and arms are looked for
ROWS_LEARNT = 6000  # that teach the mean
FOLDS = 60
USUAL = 0.9  # share of the rows that are slower than 1 in units of the process
ARM = 0.5  # m, to begin with
ROUNDS = 2  # of looking for centre and arms, each with half the steps of the one before
STEPS = 25  # of the search for the variances of an axis
STIFFNESS = 5e-3  # what a variance e times its guess must win of the logarithm of the error
TINY = 1e-6  # of the label's square: a fold cannot do better
JITTER = 1e-9
BOUNDS = (-16.0, 7.0)  # of the logarithms of variances

GUESSES = np.log(
    [
        *(1.0, 0.1, 1.0, 1.0),  # linear, and products of each power, as the mirrors have them
        *(0.01, 0.03, 0.3, 0.01, 0.03, 0.3),  # radial functions, narrow and wide, of each power
        *(0.001, 0.003, 0.003),  # those of port and starboard
        *(0.001, 0.001, 0.001),  # those without any mirror
        *(0.01, 0.003, 0.01, 0.01),  # linear and products as no mirror has them
        *(1e-4, 1e-4),  # errors of the label that grow as m^3, and that do not
    ]
)
"""Logarithms of variances to begin with, in units of the label's mean square."""


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
    images = _images(motion, motion)
    found, errors = [], []
    for axis in range(AXES):
        logs, error = _weighed(_parts(motion, motion, images, axis), motion, labels[:, axis] / unit[axis], fold[some])
        found.append(logs)
        errors.append(error * unit[axis] ** 2)
        told(2 + axis, 2 + AXES)
    many = _some(draw, len(nu), ROWS_LEARNT)
    kept = np.sort(draw.permutation(len(nu))[:points])
    tensors = _mean(hull, hull.motion(nu[many]), hull.about(tau[many]) / unit, hull.motion(nu[kept]), found, unit)
    tensors["top"] = np.array([hull.motion(nu).size.max()])
    told(2 + AXES, 2 + AXES)
    return Fit({name: value.astype(np.float32) for name, value in tensors.items()}, float(np.sqrt(np.mean(errors))))


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
    """R(g d, d') of the wide width, (8, N, M)."""
    far = 0.5 * ((one.direction**2).sum(axis=1)[:, None] + (other.direction**2).sum(axis=1))
    return np.stack([np.exp(((one.direction * g) @ other.direction.T - far) / WIDE**2) for g in MIRRORS])


def _sums(images: Array, axis: int) -> list[Array]:
    """The four sums S of `core.residual.mirrors`, (N, M) each."""
    sign = MIRRORS[:, axis]
    narrow, wide = (np.tensordot(sign, part, 1) / 8.0 for part in (images**4, images))
    return [narrow, wide, 0.5 * (images[0] + sign[PORT] * images[PORT]), images[0]]


def _mirrored(axis: int) -> NDArray[np.bool_]:
    """Which of z and its products an axis has on a hull with three planes of symmetry, (63,)."""
    return np.asarray((parities() == MIRRORS[:, [axis]]).all(axis=0))


def _parts(one: Motion, other: Motion, images: Array, axis: int) -> list[Array]:
    """Covariances of the processes, (N, M) each, in the order of GUESSES."""
    own = _mirrored(axis)
    grown = [np.outer(one.size**p, other.size**p) for p in range(1, POWERS + 1)]

    def polynomial(chosen: NDArray[np.bool_]) -> list[Array]:
        line, product = chosen[:AXES], chosen[AXES:]
        together = one.products[:, product] @ other.products[:, product].T
        return [one.z[:, line] @ other.z[:, line].T, *(together * power for power in grown)]

    radial = [part * power for part in _sums(images, axis) for power in grown]
    return [*polynomial(own), *radial, *polynomial(~own)]


def _noise(motion: Motion, logs: Array) -> Array:
    """Variance of the label's error (N,)."""
    return np.asarray(np.exp(logs[-2]) * motion.size ** (2 * POWERS) + np.exp(logs[-1]))


def _explored(nu: Array, tau: Array, fold: Rows) -> Hull:
    """Centre and arms that leave the least error of folds left out, by a search along the axes."""
    place, steps = np.concatenate([np.zeros(3), np.log(np.full(3, ARM))]), np.array([0.1 * ARM] * 3 + [np.log(2)] * 3)
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
    images, guesses = _images(motion, motion), np.exp(GUESSES)
    where = [np.flatnonzero(fold == number) for number in np.unique(fold)]
    total = 0.0
    for axis in range(AXES):
        label = labels[:, axis] / max(float(np.sqrt((tau[:, axis] ** 2).mean())), 1e-300)
        parts = _parts(motion, motion, images, axis)
        K = sum(variance * part for variance, part in zip(guesses, parts, strict=False))
        inverse = np.linalg.inv(K + np.diag(_noise(motion, GUESSES)))
        known = inverse @ label
        missed = [np.linalg.solve(inverse[np.ix_(rows, rows)], known[rows]) for rows in where]
        total += float(np.log(np.mean([np.sqrt((one**2).mean() + TINY) for one in missed])))
    return total / AXES


def _weighed(parts: list[Array], motion: Motion, label: Array, fold: Rows) -> tuple[Array, float]:
    """Logarithms of variances that leave the least error of folds left out, and its mean square."""
    covariances = [torch.from_numpy(part) for part in parts]
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

    options = {"maxiter": STEPS, "maxfun": STEPS + 10}
    found = minimize(cost, GUESSES, jac=True, method="L-BFGS-B", bounds=[BOUNDS] * len(GUESSES), options=options)
    with torch.no_grad():
        left = torch.cat(missed(torch.from_numpy(found.x)))
    return np.asarray(found.x), float(left.square().mean())


def _mean(
    hull: Hull, motion: Motion, labels: Array, kept: Motion, found: Sequence[Array], unit: Array
) -> dict[str, Array]:
    """The mean of the process on points, as tensors of the network; labels (N, 6) are in their units (6,)."""
    across, within = _images(motion, kept), _images(kept, kept)
    linear = np.zeros((AXES, AXES))
    library = np.zeros((POWERS, kept.products.shape[1], AXES))
    radial = np.zeros((len(kept.size), 4, POWERS, AXES))
    for axis, logs in enumerate(found):
        variances = np.exp(logs)
        wide, square = (
            sum(v * part for v, part in zip(variances, _parts(one, kept, images, axis), strict=False))
            for one, images in ((motion, across), (kept, within))
        )
        sure = wide / _noise(motion, logs)[:, None]
        normal = sure.T @ wide + square
        normal += JITTER * np.trace(normal) / len(normal) * np.eye(len(normal))
        alpha = unit[axis] * np.linalg.solve(normal, sure.T @ labels[:, axis])
        own = _mirrored(axis)
        rest = variances[-6:-2]
        linear[axis] = (kept.z.T @ alpha) * np.where(own[:AXES], variances[0], rest[0])
        for p in range(POWERS):
            grown = kept.size ** (p + 1) * alpha
            library[p, :, axis] = (kept.products.T @ grown) * np.where(own[AXES:], variances[1 + p], rest[1 + p])
            for s in range(4):
                radial[:, s, p, axis] = variances[4 + 3 * s + p] * grown
    return {
        "centre": hull.centre,
        "scale": hull.scale,
        "linear": linear,
        "library": library,
        "points": kept.direction,
        "weights": radial,
    }
