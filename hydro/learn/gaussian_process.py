"""Gaussian process of a hull's wrench, fitted to labels; for minutes of data, too few for networks.

Each axis is a sum of independent processes (`core.residual.mirrors`): a linear one, products of velocities,
and radial functions of the direction of motion.  The last two grow as the first to third power of the speed.
Each process exists in two forms: as the symmetry of the hull allows, and as it excludes.

Cross-validation over folds of the data selects the variances of the processes.  Thus the data decide how
drag grows with the speed, and how asymmetric the hull is.  Cross-validation also selects the arms that scale
angular velocities, and the centre of symmetry if the centre of gravity is unknown.

The drag predicted by the first stage modulates a second stage, for forces and moments separately, if that
reduces the cross-validation error.

The mean of the process is then projected on some of the rows (projected process, Rasmussen and Williams 2006,
section 8.3.4).  Its weights are those of `learn.networks.gaussian_process`.
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
from hydro.core.residual.mirrors import AXES, POWERS, PRODUCTS, STAGES, SUMS, TINY
from hydro.learn.covariances import (
    GUESSES,
    OTHERS_AT,
    PRODUCTS_AT,
    Hull,
    Motion,
    images_of,
    mirrored,
    noise_of,
    parts_of,
)

ROWS_VARIANCES = 900  # rows for the fit of the variances; its cost grows with their cube
ROWS_CENTRE = 450  # rows for the search of centre and arms
ROWS_MEAN = 4500  # rows for the final mean
FOLDS = 60  # greatest number of folds of the cross-validation
UNIT_QUANTILE = 0.9  # quantile of the motions' sizes that becomes the unit of z
ARM = 0.5  # initial arm that scales angular velocities [m]
STEPS = 25  # iterations of the search for the variances of an axis
STIFFNESS = 5e-3  # penalty on log error per squared log ratio of a variance to its initial value
LEAST = 1e-6  # added to a fold's mean squared error, in units of the label's mean square
JITTER = 1e-9  # added to the diagonal of the normal matrix, as a share of its mean
MODULATION = 1.0  # prior variance of the modulation of the second stage by the direction of drag
BOUNDS = (-16.0, 7.0)  # bounds of the logarithms of variances


class Fit(NamedTuple):
    """Result of the fit.

    Attributes:
        tensors: Tensors of the network by name, as `networks.gaussian_process.GaussianProcess` has them.
        left_out_rmse: Root mean square cross-validation error over rows and axes, in N and N m mixed.
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
    centre: Sequence[float] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Fit:
    """Return the Gaussian process of every axis of the wrench, fitted to labels, as tensors of a network.

    The mean of the process is projected on a few rows.

    Args:
        nu: Velocities (N, 6) [m/s, rad/s].
        tau: Labels, the residual wrench tau_res (N, 6) [N, N m].
        blocks: Block of each row, at least two different ones; rows of a block are consecutive.
        points: Number of rows on which the mean is projected, at most N.
        seed: Seed of the choice of rows.
        centre: Centre of gravity [m], FRD from CO; by default the centre is fitted.
        progress: Called with the number of finished steps and of all steps.
    """
    draw = np.random.default_rng(seed)
    fold = _folds(blocks)
    report = progress or (lambda done, of: None)
    some = _every_nth(draw, len(nu), ROWS_CENTRE)
    hull = _fit_centre_and_arms(nu[some], tau[some], fold[some], centre)
    report(1, 2 + AXES)
    some = _every_nth(draw, len(nu), ROWS_VARIANCES)
    motion, labels = hull.motion(nu[some]), hull.about(tau[some])
    unit = np.sqrt((labels**2).mean(axis=0))
    unit[unit == 0.0] = 1.0
    scaled, images, found = labels / unit, images_of(motion, motion), []
    for axis in range(AXES):
        parts = parts_of(motion, motion, images, axis)
        found.append(_fit_variances(parts, motion, scaled[:, axis], fold[some]))
        report(2 + axis, 2 + AXES)
    residual, modulated = _both_stages(motion, images, scaled, unit, fold[some], found)
    many = _every_nth(draw, len(nu), ROWS_MEAN)
    kept = hull.motion(nu[draw.permutation(len(nu))[:points]])
    known = hull.about(tau[many]) / unit
    tensors = _project_mean(hull.motion(nu[many]), known, kept, found, unit, modulated)
    tensors |= {"centre": hull.centre, "scale": hull.scale, "top": np.array([hull.motion(nu).size.max()])}
    report(2 + AXES, 2 + AXES)
    stored = {name: value.astype(np.float32) for name, value in tensors.items()}
    return Fit(stored, float(np.sqrt(((unit * residual) ** 2).mean())))


def _folds(blocks: Sequence[str]) -> Rows:
    """Return the fold of each row: a block, or several neighbouring blocks if there are many."""
    names = np.asarray(blocks)
    block = np.concatenate([[0], np.cumsum(names[1:] != names[:-1])])
    return np.asarray(block // -(-(int(block[-1]) + 1) // FOLDS), dtype=np.int64)


def _every_nth(draw: np.random.Generator, count: int, most: int) -> Rows:
    """Return every k-th of `count` rows with a random start, at most `most`."""
    step = -(-count // most)
    return np.arange(int(draw.integers(step)), count, step)


def _fit_centre_and_arms(nu: Array, tau: Array, fold: Rows, centre: Sequence[float] | None) -> Hull:
    """Find the arms that scale angular velocities, and the centre if not given, by cross-validation.

    The search moves along one coordinate at a time.  The second stage is modulated by moments about the
    centre, so the search for the centre uses both stages.
    """
    place = np.concatenate([np.zeros(3) if centre is None else centre, np.log(np.full(3, ARM))])
    searches = [((3, 4, 5), np.log(2.0), 2, 1), ((2, 0, 1), 0.1 * ARM, 3, 2)]
    for numbers, step, rounds, stages in searches[: 2 if centre is None else 1]:
        cost = _cost(_hull(nu, place), nu, tau, fold, stages)
        for turn in range(rounds):
            for number in numbers:
                for sign in (1.0, -1.0):
                    tried = place.copy()
                    tried[number] += sign * step / 2**turn
                    if (now := _cost(_hull(nu, tried), nu, tau, fold, stages)) < cost:
                        place, cost = tried, now
                        break
    return _hull(nu, place)


def _hull(nu: Array, place: Array) -> Hull:
    """Return the hull whose scale makes a usual motion have size 1.

    Args:
        nu: Velocities (N, 6) [m/s, rad/s].
        place: Centre x y z [m], and the logarithms of the arms about x, y, z [log m], (6,).
    """
    scale = np.concatenate([np.ones(3), np.exp(place[3:])])
    usual = float(np.quantile(Hull(place[:3], scale).motion(nu).size, UNIT_QUANTILE))
    return Hull(place[:3], scale / usual)


def _cost(hull: Hull, nu: Array, tau: Array, fold: Rows, stages: int) -> float:
    """Return the mean over axes of the log cross-validation error, with the variances of GUESSES."""
    motion, labels = hull.motion(nu), hull.about(tau)
    unit = np.maximum(np.sqrt((tau**2).mean(axis=0)), TINY)
    given = (motion, images_of(motion, motion), labels / unit, unit, fold)
    residual, _ = _both_stages(*given, [GUESSES] * AXES, stages)
    return _error(residual, fold)


def _both_stages(
    motion: Motion,
    images: Array,
    labels: Array,
    unit: Array,
    fold: Rows,
    found: Sequence[Array],
    stages: int = 2,
) -> tuple[Array, list[bool]]:
    """Return the cross-validation residuals (N, 6), and the axes for which the second stage is better.

    The second stage is used for all forces or none, and for all moments or none, because they modulate each
    other.

    Args:
        motion: N motions.
        images: Covariances between mirror images of the motions (8, N, N), from `images_of`.
        labels: Wrenches about the centre (N, 6), in units of `unit`.
        unit: Root mean square of each axis (6,) [N, N m].
        fold: Fold of each row (N,).
        found: Logarithms of the variances of each axis, in the order of GUESSES.
        stages: Number of stages, 1 or 2.
    """
    parts = [parts_of(motion, motion, images, axis) for axis in range(AXES)]
    first = [
        _cross_validate(_process(parts[axis], motion, logs), labels[:, axis], fold)
        for axis, logs in enumerate(found)
    ]
    residual = np.stack([one.residual for one in first], axis=1)
    modulated = [False] * AXES
    if stages == 1:
        return residual, modulated
    drags = ([one.fitted for one in first], [one.drag for one in first])
    seen, unseen = (_modulation(unit * np.stack(drag, axis=1)) / unit[:, None] for drag in drags)
    again = np.empty_like(residual)
    for axis, logs in enumerate(found):
        columns = seen[:, axis]
        process = _process(parts[axis], motion, logs, columns)
        other = unseen[:, axis] - columns
        again[:, axis] = _cross_validate(process, labels[:, axis], fold, (columns, other)).residual
    for half in (range(3), range(3, AXES)):
        if _error(again[:, half], fold) < _error(residual[:, half], fold):
            residual[:, half] = again[:, half]
            modulated[half.start : half.stop] = [True] * 3
    return residual, modulated


class Process(NamedTuple):
    """Gaussian process of one axis.

    Attributes:
        whole: Covariance of the labels, their errors included, (N, N).
        even: Covariance of the forces other than drag, those even in velocity, (N, N).
        noise: Variance of the label's error, (N,).
    """

    whole: Array
    even: Array
    noise: Array


class CrossValidation(NamedTuple):
    """Predictions for rows whose fold was left out, (N,) each.

    Attributes:
        residual: Label minus prediction.
        drag: Predicted drag.
        fitted: Drag fitted with all folds.
    """

    residual: Array
    drag: Array
    fitted: Array


def _process(parts: Sequence[Array], motion: Motion, logs: Array, modulation: Array | None = None) -> Process:
    """Build the process of an axis.

    Args:
        parts: Covariance matrices (N, N) of `parts_of`.
        motion: N motions.
        logs: Logarithms of the variances, in the order of GUESSES.
        modulation: Columns (N, 3) of `_modulation` for the second stage; None for the first.
    """
    *parts, even, other = parts
    variances, noise = np.exp(logs), noise_of(motion, logs)
    whole = np.asarray(sum(v * part for v, part in zip(variances, parts, strict=False))) + np.diag(noise)
    if modulation is not None:
        whole += MODULATION * modulation @ modulation.T
    return Process(whole, variances[PRODUCTS_AT] * even + variances[OTHERS_AT] * other, noise)


def _cross_validate(
    process: Process, label: Array, fold: Rows, modulation: tuple[Array, Array] | None = None
) -> CrossValidation:
    """Predict every fold from the labels of all others.

    Args:
        process: Process of the axis.
        label: Labels (N,) in units of the process.
        fold: Fold of each row (N,).
        modulation: Columns (N, 3) with the fitted drag, and their change (N, 3) with the drag predicted
            without the row's fold.
    """
    inverse = np.linalg.inv(process.whole)
    known = inverse @ label
    residual, even = np.empty_like(label), np.empty_like(label)
    for number in np.unique(fold):
        rows = np.flatnonzero(fold == number)
        residual[rows] = np.linalg.solve(inverse[np.ix_(rows, rows)], known[rows])
        without = known - inverse[:, rows] @ residual[rows]
        even[rows] = process.even[rows] @ without
        if modulation is not None:
            residual[rows] -= MODULATION * modulation[1][rows] @ (modulation[0].T @ without)
    fitted = label - process.noise * known - process.even @ known
    return CrossValidation(residual, label - residual - even, fitted)


def _error(residual: Array, fold: Rows) -> float:
    """Return the mean over axes of log(mean over folds of the root mean square residual).

    Args:
        residual: Residuals of each row and axis (N, axes).
        fold: Fold of each row (N,).
    """
    number = np.unique(fold, return_inverse=True)[1]
    squares = np.stack([np.bincount(number, column**2) for column in residual.T]) / np.bincount(number)
    return float(np.log(np.sqrt(squares + LEAST).mean(axis=1)).mean())


def _modulation(drag: Array) -> Array:
    """Return F_i |F_j| / |F| (N, 6, 3) of the drag F (N, 6), separately for forces and for moments.

    The index i runs over the six axes, j over the three forces or moments, like the norm |F|.
    """
    halves = drag.reshape(-1, 2, 3)
    size = np.maximum(np.sqrt((halves**2).sum(axis=2)), TINY)
    made = halves[:, :, :, None] * np.abs(halves)[:, :, None, :] / size[:, :, None, None]
    return np.asarray(made.reshape(-1, AXES, 3))


def _fit_variances(parts: list[Array], motion: Motion, label: Array, fold: Rows) -> Array:
    """Find the logarithms of the variances with the least cross-validation error."""
    covariances = [torch.from_numpy(part) for part in parts[:-2]]
    guesses, truth = torch.from_numpy(GUESSES), torch.from_numpy(label)
    growth = torch.from_numpy(motion.size ** (2 * POWERS))
    where = [torch.from_numpy(np.flatnonzero(fold == number)) for number in np.unique(fold)]

    def residual(logs: torch.Tensor) -> list[torch.Tensor]:
        variances = torch.exp(logs)
        K = sum((v * part for v, part in zip(variances, covariances, strict=False)), torch.zeros(()))
        inverse = torch.linalg.inv(K + torch.diag(variances[-2] * growth + variances[-1]))
        known = inverse @ truth
        return [torch.linalg.solve(inverse[rows][:, rows], known[rows]) for rows in where]

    def cost(values: Array) -> tuple[float, Array]:
        logs = torch.tensor(values, requires_grad=True)
        error = torch.stack([torch.sqrt(one.square().mean() + LEAST) for one in residual(logs)]).mean()
        total = torch.log(error) + STIFFNESS * (logs - guesses).square().sum()
        torch.autograd.backward(total)
        assert logs.grad is not None
        return float(total.detach()), logs.grad.numpy()

    limits = [BOUNDS] * len(GUESSES)
    options = {"maxiter": STEPS, "maxfun": STEPS + 10}
    found = minimize(cost, GUESSES, jac=True, method="L-BFGS-B", bounds=limits, options=options)
    return np.asarray(found.x)


def _project_mean(
    motion: Motion,
    labels: Array,
    kept: Motion,
    found: Sequence[Array],
    unit: Array,
    modulated: Sequence[bool],
) -> dict[str, Array]:
    """Project the mean of both stages on a few points; return tensors of the network.

    Args:
        motion: N motions.
        labels: Wrenches about the centre (N, 6), in units of `unit`.
        kept: The motions on which the mean is projected.
        found: Logarithms of the variances of each axis, in the order of GUESSES.
        unit: Root mean square of each axis (6,) [N, N m].
        modulated: Whether each axis uses the modulation of the second stage.
    """
    linear = np.zeros((STAGES, AXES, AXES))
    library = np.zeros((STAGES, POWERS, PRODUCTS, AXES))
    radial = np.zeros((len(kept.size), STAGES, SUMS, POWERS, AXES))
    modulation, drag = np.zeros((AXES, 3)), np.empty_like(labels)
    across, within, covariances = images_of(motion, kept), images_of(kept, kept), []
    for axis, logs in enumerate(found):
        parts, square = parts_of(motion, kept, across, axis), parts_of(kept, kept, within, axis)
        columns = sum(v * part for v, part in zip(np.exp(logs), parts[:-2], strict=False))
        prior = sum(v * part for v, part in zip(np.exp(logs), square[:-2], strict=False))
        even = np.exp(logs[PRODUCTS_AT]) * parts[-2] + np.exp(logs[OTHERS_AT]) * parts[-1]
        covariances.append((np.asarray(columns), np.asarray(prior), even))
    for stage in range(STAGES):
        for axis, logs in enumerate(found):
            columns, prior, even = covariances[axis]
            if stage and modulated[axis]:
                columns = np.hstack([columns, _modulation(unit * drag)[:, axis] / unit[axis]])
                prior = block_diag(prior, np.eye(3) / MODULATION)
            alpha = _solve_weights(columns, prior, labels[:, axis], noise_of(motion, logs))
            on_points = alpha[: len(kept.size)]
            if not stage:
                drag[:, axis] = columns @ alpha - even @ on_points
            elif modulated[axis]:
                modulation[axis] = alpha[len(kept.size) :]
            folded = _weights_of_terms(kept, unit[axis] * on_points, np.exp(logs), axis)
            linear[stage, axis], library[stage, :, :, axis], radial[:, stage, :, :, axis] = folded
    return {
        "steering": modulation,
        "linear": linear,
        "library": library,
        "points": kept.direction,
        "weights": radial,
    }


def _solve_weights(columns: Array, prior: Array, label: Array, noise: Array) -> Array:
    """Return the weights (K,) of K columns that fit noisy labels, by regularised least squares.

    Args:
        columns: (N, K).
        prior: Inverse prior covariance of the weights (K, K).
        label: (N,).
        noise: Variance of each label's error (N,).
    """
    sure = columns.T / noise
    normal = sure @ columns + prior
    normal += JITTER * np.trace(normal) / len(normal) * np.eye(len(normal))
    return np.asarray(np.linalg.solve(normal, sure @ label))


def _weights_of_terms(kept: Motion, alpha: Array, variances: Array, axis: int) -> tuple[Array, Array, Array]:
    """Convert weights of K points to weights of z (6,), of products (3, 57) and of points (K, 3, 3).

    Args:
        kept: Motions at the points.
        alpha: Weights of the points (K,).
        variances: Variances of the axis, in the order of GUESSES.
        axis: Axis of the wrench, 0 to 5.
    """
    own, rest = mirrored(axis), variances[OTHERS_AT - 2 :]
    grown = kept.size ** np.arange(1, POWERS + 1)[:, None] * alpha
    linear = np.where(own[:AXES], variances[0], rest[0]) * (kept.z.T @ alpha)
    sizes = np.where(own[AXES:], variances[1 : 1 + POWERS, None], rest[1 : 1 + POWERS, None])
    radial = variances[1 + POWERS : 1 + POWERS * (1 + SUMS)].reshape(SUMS, POWERS)
    return linear, sizes * (grown @ kept.products), np.einsum("sp,pk->ksp", radial, grown)
