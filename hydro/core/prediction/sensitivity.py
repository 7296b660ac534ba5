"""Least-squares problem of predicted shots: residuals, and their derivatives by every parameter.

A shot is a prediction of a few seconds, compared with the recording.  Derivatives come from the variational
equation (`simulation.variational_equation`) for parameters that act on forces, and from the prediction itself
for parameters of the DVL.  Parameters that move the times at which commands take effect are differentiated by
finite differences of predictions.

Derivatives change little within some hundredths of a second.  Of a fast recording they are computed in some
rows only, the nodes, and each row counts at its nearest node: its residual times the derivatives there.  So
the sum over rows needs the mean residual about each node alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Rows
from hydro.core.compiled import kernel
from hydro.core.effects import sensor
from hydro.core.effects.program import STATE_COUNT, THRUSTER_TABLE, changed_effects
from hydro.core.prediction import multiple_shooting
from hydro.core.prediction.multiple_shooting import (
    ENDLESS,
    Answers,
    Prepared,
    places_of,
)
from hydro.core.prediction.normal_equations import Normal, eliminate, taken
from hydro.core.recording.shots import CHANNELS, Shots
from hydro.core.simulation.dynamics import BODY
from hydro.core.simulation.variational_equation import FORCES, THRUST, WHOLE, Changes
from hydro.core.threads import spread
from hydro.core.vehicle.thrusters import same_states

INTERVAL = 0.061
"""Greatest time over which derivatives advance at once [s]: three steps of 20 ms.

Derivatives stay within 1 % of exact ones.  The prediction itself has steps of its own.
"""
FARTHEST = 1e3
"""Prior standard deviation of a free initial state, wide in every unit [m, rad, m/s, rad/s]."""


@dataclass(frozen=True)
class Moved:
    """Compiled vehicle, and P copies with one changed parameter each, for numerical derivatives.

    Attributes:
        base: The vehicle.
        others: P copies of the vehicle with a changed parameter.
        shares: Size of each change, in the unit of the problem's parameters, (P,).
    """

    base: Prepared
    others: Sequence[Prepared]
    shares: Array


@dataclass(frozen=True)
class Varied:
    """The Q parameters that the variational equation can differentiate, because they act on forces.

    Attributes:
        of: Index of each of the Q parameters among all parameters of the problem, (Q,).
        changes: For each parameter, the numbers of the compiled vehicle that it moves.
        ahead: Change of the initial internal states in each of S shots per unit of each parameter, (S,
            states, Q).
        own: Initial internal states of all effects that the vehicle itself lacks and a parameter belongs to,
            one after the other, in each shot, (S, states of these effects).
    """

    of: Rows
    changes: Changes
    ahead: Array
    own: Array


@dataclass(frozen=True)
class Around:
    """Compared rows about the J nodes of s shots.

    Attributes:
        begin: Place of the first row of each node among the compared rows, (J,).
        counted: Mask of the samples, (s, K - lead, 12); None if every value is a sample.
        root: Root of the number of samples of each node, (s, J, 12).
    """

    begin: Rows
    counted: NDArray[np.bool_] | None
    root: Array

    def gathered(self, each: Array) -> Array:
        """Return the sum over the samples of each node, divided by the root of their number, (s, J, 12).

        Args:
            each: Values of the compared rows, (s, K - lead, 12).
        """
        if self.counted is not None:
            each = np.where(self.counted, each, 0.0)
        if len(self.begin) == each.shape[1]:
            return each
        total = np.add.reduceat(each, self.begin, axis=1)
        return np.asarray(total / np.maximum(self.root, 1.0))

    def scatter(self, each: Array, gathered: Array) -> Array:
        """Return the sum of squares of samples about the means of their nodes, (s, 12).

        Args:
            each: Values of the compared rows, (s, K - lead, 12).
            gathered: Result of `gathered`.
        """
        if len(self.begin) == each.shape[1]:
            return np.zeros((len(each), CHANNELS))
        if self.counted is not None:
            each = np.where(self.counted, each, 0.0)
        squares = np.einsum("skc,skc->sc", each, each)
        return np.asarray(np.maximum(squares - np.einsum("sjc,sjc->sc", gathered, gathered), 0.0))


@dataclass(frozen=True)
class Nodes:
    """Rows of a shot in which its derivatives are computed, the nodes.

    Attributes:
        rows: The rows, (all,), the first and the last of the shot among them.
        stride: Integration steps in one interval of the derivatives.
        first: Number of the first node that is nearest to a compared row.
        begin: Place of the first row of each of J nodes from there among the compared rows, (J,).
    """

    rows: Rows
    stride: int
    first: int
    begin: Rows

    @classmethod
    def of(cls, shots: Shots) -> Nodes:
        """Return the nodes of every shot.

        Args:
            shots: The shots.  In waves every row is a node, since the waves' covariance needs all rows.
        """
        steps, dt = shots.steps or multiple_shooting.most_steps(shots), shots.record.dt
        stride = max(int(INTERVAL * steps / dt), 1)
        if steps == 1:
            stride = 1 if shots.swell is not None else stride - (stride + 1) % 2  # odd: a node in the middle
        rows = np.arange(0, shots.length - 1, stride if steps == 1 else 1)
        rows = np.append(rows, shots.length - 1)
        compared = np.arange(shots.lead, shots.length)
        owner = np.searchsorted(0.5 * (rows[1:] + rows[:-1]), compared)
        owners, begin = np.unique(owner, return_index=True)
        return cls(rows, stride, int(owners[0]), begin)

    def around(self, error: Array, counted: NDArray[np.bool_] | None) -> Around:
        """Return the compared rows about the nodes of s shots.

        Args:
            error: Residuals, (s, K - lead, 12).
            counted: Mask of the samples among them; None if all are samples.
        """
        if counted is None:
            sizes = np.diff(np.append(self.begin, error.shape[1]))
            number = np.broadcast_to(sizes[:, None], (len(error), len(sizes), CHANNELS))
        else:
            number = np.add.reduceat(counted, self.begin, axis=1, dtype=float)
        return Around(self.begin, counted, np.sqrt(number))


def linearise(
    base: Prepared,
    moved: Sequence[Prepared],
    steps: Sequence[float],
    shots: Shots,
    *,
    threads: int | None = None,
) -> Normal:
    """Return the least-squares problem of P parameters, linearised about a vehicle.

    The initial states of the shots are eliminated shot by shot.

    Args:
        base: Compiled vehicle, prepared for the shots.
        moved: P copies of the vehicle with one changed parameter each.
        steps: Size of each change, in the unit of the problem's parameters.
        shots: The shots.
        threads: Number of threads; by default, the number of cores.

    Returns:
        Gram matrices per shot, and the responses of the initial states to the parameters.
    """
    count, near = len(moved), Moved(base, moved, np.asarray(steps, float))
    pieces = len(shots.starts)
    gram = np.empty((pieces, count + 1, count + 1))
    follow = np.empty((pieces, CHANNELS, count + 1))
    channels = np.zeros((pieces, CHANNELS))
    known = np.broadcast_to(shots.trust**-2, (pieces, CHANNELS))
    used = np.full(pieces, float(CHANNELS))
    logged = [i for i, other in enumerate(moved) if _same_motion(base, other)]
    varied = _varied(near, logged)
    rest = [i for i in range(count) if i not in logged and i not in varied.of]
    order = np.argsort([*varied.of, *logged, *rest])
    order = np.concatenate([np.arange(CHANNELS), CHANNELS + order, [CHANNELS + count]])
    initial = None if shots.anchor is None else _initial_columns(near, shots)
    nodes = Nodes.of(shots)

    def work(part: slice) -> None:
        states, columns = _predicted(base, varied, shots, part, count, nodes)
        done = CHANNELS + len(varied.of)
        _through_log(near, logged, shots, nodes, states, columns, done)
        counted = shots.weights(part)
        with np.errstate(over="ignore", invalid="ignore"):
            error = _residuals(shots, part, states)
            columns, around = columns[:, nodes.first :], nodes.around(error, counted)
            columns[..., -1] = around.gathered(error)
            _weigh(1.0 / shots.sigma, around.root, columns[..., : done + len(logged)], columns[..., -1])
            squares = around.scatter(error, columns[..., -1])
            _again(near, rest, shots, part, around, error, columns[..., done + len(logged) : -1])
        flat = columns.reshape(len(states), -1, CHANNELS + count + 1)
        lost = ~(squares < ENDLESS**2).all(axis=1) | ~(np.abs(flat[..., -1]) < ENDLESS).all(axis=1)
        wild = ~((flat.max(axis=(1, 2)) < ENDLESS) & (flat.min(axis=(1, 2)) > -ENDLESS))
        flat[wild, :, :-1] = 0.0  # close to divergence: no derivative available
        flat[lost], squares[lost] = 0.0, 0.0
        flat = shots.calmed(flat, part)
        whole = np.stack([one.T @ one for one in flat])[:, order[:, None], order]
        whole[:, -1, -1] += squares.sum(axis=1)
        if counted is not None:
            used[part] = taken(whole, CHANNELS, known[part])
        if initial is not None:
            whole += initial[part].transpose(0, 2, 1) @ initial[part]
        gram[part], follow[part] = eliminate(whole, CHANNELS, known[part])
        gram[part][lost, -1, -1] = np.inf
        left = flat[..., -1] - np.einsum("srz,sz->sr", flat[..., :CHANNELS], follow[part][..., -1])
        channels[part] = squares + (left.reshape(len(states), -1, CHANNELS) ** 2).sum(axis=1)

    spread(work, multiple_shooting.parts(pieces, threads), threads)
    if shots.seen is None:
        return Normal(gram, shots.residuals - CHANNELS, channels, follow)
    compared = shots.seen[:, shots.lead :].sum(axis=1)
    freedom = np.maximum(compared.sum(axis=1) - used, 1.0)
    return Normal(gram, freedom, channels, follow, compared)


def _initial_columns(near: Moved, shots: Shots) -> Array:
    """Return weighted columns and residuals of the logged initial states of anchored shots.

    A parameter of the DVL changes the logged state of CO, not the present state.

    Returns:
        (S, 12, 12 + P + 1): columns of the initial state, columns of the P parameters, and the residual.
    """
    model = near.base.model
    columns = np.zeros((len(shots.starts), CHANNELS, CHANNELS + len(near.others) + 1))
    columns[:, range(CHANNELS), range(CHANNELS)] = shots.anchor
    columns[..., -1] = error = multiple_shooting.initial_residuals(model, shots)
    for i, (other, share) in enumerate(zip(near.others, near.shares, strict=True), CHANNELS):
        if not np.array_equal(other.model.log, model.log):
            columns[..., i] = (error - multiple_shooting.initial_residuals(other.model, shots)) / share
    return columns


def beginnings(base: Prepared, shots: Shots) -> Array:
    """Return the standard deviations with which the samples of a shot determine its initial state, (12,).

    They are of position [m], small rotation [rad], velocity [m/s] and rates [rad/s]: medians over the shots,
    at most FARTHEST.

    Args:
        base: Compiled vehicle, prepared for the shots.
        shots: The shots.
    """
    varied, nodes = _varied(Moved(base, (), np.zeros(0)), ()), Nodes.of(shots)
    errors = np.empty((len(shots.starts), CHANNELS))
    for part in multiple_shooting.parts(len(shots.starts), 1):
        states, columns = _predicted(base, varied, shots, part, 0, nodes)
        error, columns = _residuals(shots, part, states), columns[:, nodes.first :, :, :-1]
        around = nodes.around(error, shots.weights(part))
        _weigh(1.0 / shots.sigma, around.root, columns, around.gathered(error))
        flat = np.nan_to_num(columns.reshape(len(states), -1, CHANNELS))
        information = flat.transpose(0, 2, 1) @ flat + FARTHEST**-2 * np.eye(CHANNELS)
        errors[part] = np.sqrt(np.einsum("sii->si", np.linalg.inv(information)))
    return np.asarray(np.median(errors, axis=0))


def _same_motion(base: Prepared, other: Prepared) -> bool:
    """Return whether two candidates predict the same motion and differ at most in their DVL errors."""
    return np.array_equal(base.model.program.flat, other.model.program.flat) and np.array_equal(
        base.memory, other.memory
    )


def _varied(near: Moved, logged: Sequence[int]) -> Varied:
    """Return the parameters that the variational equation can differentiate.

    Args:
        near: Candidate and its copies with a changed parameter.
        logged: Indices of the parameters of the DVL alone, which are left out.
    """
    base, program = near.base, near.base.model.program
    flat, states = program.flat, program.states
    of, kinds, where, ahead = [], [], [], []
    own, states_at, state = [np.zeros((len(base.memory), 0))], list[tuple[int, int]](), 0
    programs = dict[bytes, tuple[int, int]]()

    def placed(its: Array) -> tuple[int, int]:
        """Return start and end of a program in the concatenation, in which each program occurs once."""
        begin = sum(end - start for start, end in programs.values())
        return programs.setdefault(its.tobytes(), (begin, begin + its.size))

    for i, (other, share) in enumerate(zip(near.others, near.shares, strict=True)):
        its = other.model.program.flat
        alike = np.array_equal(base.model.log, other.model.log)
        if i in logged or not alike:
            continue
        if not same_states(base.model.thrusters, other.model.thrusters):
            continue
        pair = changed_effects(flat, its)
        if pair is not None:
            kind = FORCES
        elif _thrust_alone(flat, its):
            kind, pair = THRUST, (its, its[:0])
        else:
            kind, pair = WHOLE, (its, its[:0])
        if other.model.program.states != states + pair[0][STATE_COUNT] * (kind == FORCES):
            continue
        of.append(i)
        kinds.append(kind)
        where.append([*placed(pair[0]), *placed(pair[1])])
        ahead.append((other.memory[:, :states] - base.memory) / share)
        own.append(other.memory[:, states:])
        states_at.append((state, state + own[-1].shape[1]))
        state = states_at[-1][1]
    return Varied(
        np.array(of, np.int64),
        Changes(
            np.array(kinds, np.int64),
            np.frombuffer(b"".join(programs)).copy(),  # writable, as `NO_CHANGES` is
            np.array(where, np.int64).reshape(-1, 4),
            np.array(states_at, np.int64).reshape(-1, 2),
            near.shares[of],
        ),
        np.stack(ahead, axis=-1) if ahead else np.zeros((*base.memory.shape, 0)),
        np.hstack(own),
    )


def _thrust_alone(flat: Array, other: Array) -> bool:
    """Return whether two programs of equal length differ only in their thruster tables."""
    begin = int(flat[THRUSTER_TABLE])
    return flat.size == other.size and np.array_equal(flat[:begin], other[:begin])


def _predicted(
    base: Prepared, varied: Varied, shots: Shots, part: slice, count: int, nodes: Nodes
) -> tuple[Array, Array]:
    """Return predicted states (s, length, 13), and partly filled columns (s, nodes, 12, 12 + count + 1)."""
    places, known = places_of(shots, part), CHANNELS + len(varied.of)
    states = np.empty((places.starts.size, shots.length, BODY))
    columns = np.empty((places.starts.size, len(nodes.rows), CHANNELS, CHANNELS + count + 1))
    ahead, own = np.ascontiguousarray(varied.ahead[part]), np.ascontiguousarray(varied.own[part])
    answers = Answers(varied.changes, ahead, own, columns[..., :known], nodes.stride, wanted=True)
    multiple_shooting.shoot(
        base.model.program.flat, places, base.initial_states(shots.first, part), states, answers
    )
    return states, columns


def _through_log(
    near: Moved, logged: Sequence[int], shots: Shots, nodes: Nodes, states: Array, columns: Array, done: int
) -> None:
    """Apply the DVL errors to states and columns, and fill the columns of the DVL's parameters.

    A reading is linear in the motion except for its bias.

    Args:
        near: Candidate and its copies with a changed parameter.
        logged: Indices of the parameters of the DVL.
        shots: The shots.
        nodes: Rows of the columns.
        states: Predicted states, (s, length, 13), changed.
        columns: Columns, (s, nodes, 12, 12 + P + 1), changed.
        done: Number of columns that are filled already.
    """
    log, clock = near.base.model.log, np.arange(shots.length) * shots.record.dt
    nu = np.nan_to_num(states[..., 7:], nan=1e6, posinf=1e6, neginf=-1e6)
    at, there, some = clock[nodes.rows], nu[:, nodes.rows], states[:, nodes.rows]
    read, place = sensor.measured(log, at, there), sensor.logged_position(log, some)
    for i, which in enumerate(logged, done):
        other = near.others[which].model.log
        away = sensor.logged_position(other, some) - place
        columns[:, :, :3, i], columns[:, :, 3:6, i] = away[..., :3] / near.shares[which], 0.0
        columns[:, :, 6:, i] = (sensor.measured(other, at, there) - read) / near.shares[which]
    if log.any():
        unbiased = log.copy()
        unbiased[sensor.BIAS] = 0.0
        if log[sensor.POINT].any():
            columns[:, :, :3, :done] = sensor.logged_shift(log, some[..., 3:7], columns[..., :done])
        motion = np.nan_to_num(columns[:, :, 6:, :done]).transpose(0, 3, 1, 2)
        columns[:, :, 6:, :done] = sensor.measured(unbiased, at, motion).transpose(0, 2, 3, 1)
        states[..., :3] = sensor.logged_position(log, states)[..., :3]
        states[..., 7:] = sensor.measured(log, clock, nu)


def _again(
    near: Moved, rest: Sequence[int], shots: Shots, part: slice, around: Around, still: Array, columns: Array
) -> None:
    """Fill the columns of the parameters `rest` by differences of residuals, (s, nodes, 12, R).

    `still` holds the residuals of the candidate, (s, K - lead, 12).
    """
    for i, which in enumerate(rest):
        moved = multiple_shooting.residuals(near.others[which], shots, None, part, calmed=False)
        columns[..., i] = around.gathered((still - moved) / near.shares[which])


def _residuals(shots: Shots, part: slice, states: Array) -> Array:
    """Return the weighted residuals of predicted states of a slice of shots, without the lead, (s, K, 12)."""
    error = np.empty((len(states), shots.length - shots.lead, CHANNELS))
    multiple_shooting.deviate(states, shots.measured[part], shots.lead, 1.0 / shots.sigma, error)
    return error


@kernel
def _weigh(weight: Array, root: Array, columns: Array, error: Array) -> None:
    """Weight columns of changes of the prediction, and turn those of the attitude to its residual.

    The attitude's residual e is twice the vector part of q_predicted^* q_measured = (a, e/2); a rotation of
    the prediction by a small theta changes it by -(a theta + theta x e/2).

    Args:
        weight: Weights, (12,).
        root: Root of the number of samples about each node, (S, J, 12).
        columns: Changes, (S, J, 12, P), overwritten.
        error: Sums of weighted residuals of `multiple_shooting.deviate` about each node, divided by `root`,
            (S, J, 12).
    """
    for m in range(error.shape[0]):
        for k in range(error.shape[1]):
            x, e, n = columns[m, k], error[m, k], root[m, k]
            a = 0.5 * e[3] / (weight[3] * max(n[3], 1.0))
            b = 0.5 * e[4] / (weight[4] * max(n[4], 1.0))
            c = 0.5 * e[5] / (weight[5] * max(n[5], 1.0))
            whole = np.sqrt(max(1.0 - a * a - b * b - c * c, 0.0))
            for i in range(x.shape[1]):
                p, q, r = x[3, i], x[4, i], x[5, i]
                x[3, i] = whole * p + q * c - r * b
                x[4, i] = whole * q + r * a - p * c
                x[5, i] = whole * r + p * b - q * a
            for j in range(CHANNELS):
                factor = weight[j] * n[j]
                for i in range(x.shape[1]):
                    x[j, i] *= factor
