"""The least-squares problem of predicted shots: their residuals, and how these answer to every parameter.

Derivatives come from the variational equation (`identification.variational_equation`) where a parameter acts
on forces, and from the prediction itself where it acts on the velocity log alone.  What moves the moments at
which commands take effect, or brings internal states of its own, is predicted once more and the difference
taken.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.compiled import jit
from hydro.core.effects import sensor
from hydro.core.effects.program import THRUSTER_TABLE, changed_effects
from hydro.core.identification import multiple_shooting, variational_equation
from hydro.core.identification.multiple_shooting import CHANNELS, ENDLESS, TOGETHER, TRUST, Loaded, Shots
from hydro.core.identification.normal_equations import Normal, eliminate
from hydro.core.simulation.integrate import BODY
from hydro.core.vehicle.thrusters import same_states


@dataclass(frozen=True)
class Varied:
    """Parameters that act on forces, as `identification.variational_equation.vary` takes them.

    Attributes:
        of: Which of all parameters, (Q,).
        kinds: (Q,).
        programs: Programs in a row.
        where: (Q, 4).
        ahead: Change of the internal states at the beginning of every shot, (S, states, Q).
    """

    of: Rows
    kinds: Rows
    programs: Array
    where: Rows
    ahead: Array


def linearise(
    base: Loaded,
    moved: Sequence[Loaded],
    steps: Sequence[float],
    shots: Shots,
    *,
    threads: int | None = None,
) -> Normal:
    """The least-squares problem about a candidate, with the beginnings of the shots eliminated.

    Args:
        base: The candidate.
        moved: The same with one parameter changed, one each.
        steps: By how much, in the unit that the parameters of the problem are to have.
        shots: The shots.
        threads: By default, as many as there are cores.

    Returns:
        Gram matrices per shot, and how the beginnings go along with the parameters.
    """
    count, shares = len(moved), np.asarray(steps, float)
    pieces = len(shots.starts)
    gram = np.empty((pieces, count + 1, count + 1))
    follow = np.empty((pieces, CHANNELS, count + 1))
    channels = np.zeros((pieces, CHANNELS))
    logged = [i for i, other in enumerate(moved) if _same_motion(base, other)]
    varied = _varied(base, moved, shares, logged)
    rest = [i for i in range(count) if i not in logged and i not in varied.of]
    order = np.argsort([*varied.of, *logged, *rest])
    order = np.concatenate([np.arange(CHANNELS), CHANNELS + order, [CHANNELS + count]])

    def work(begin: int) -> None:
        part = slice(begin, begin + TOGETHER)
        states, columns = _predicted(base, varied, shares, shots, part, count)
        done = CHANNELS + len(varied.of)
        _through_log(base, moved, logged, shares, shots, states, columns, done)
        columns = columns[:, shots.lead :]
        with np.errstate(over="ignore", invalid="ignore"):
            _weigh(
                states[:, shots.lead :],
                shots.measured[part][:, shots.lead :],
                1.0 / shots.sigma,
                columns[..., : done + len(logged)],
                columns[..., -1],
            )
            _again(columns[..., -1], moved, rest, shares, shots, part, columns[..., done + len(logged) : -1])
        flat = columns.reshape(len(states), shots.residuals, CHANNELS + count + 1)
        tame = np.abs(flat) < ENDLESS
        lost = ~tame[..., -1].all(axis=1)
        flat[~tame.all(axis=(1, 2)), :, :-1] = 0.0  # at the brink: no derivative to be had
        flat[lost] = 0.0
        whole = np.stack([one.T @ one for one in flat])[:, order[:, None], order]
        gram[part], follow[part] = eliminate(whole, CHANNELS, TRUST**-2)
        gram[part][lost, -1, -1] = np.inf
        left = flat[..., -1] - np.einsum("srz,sz->sr", flat[..., :CHANNELS], follow[part][..., -1])
        channels[part] = (left.reshape(len(states), -1, CHANNELS) ** 2).sum(axis=1)

    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        list(pool.map(work, range(0, pieces, TOGETHER)))
    return Normal(gram, shots.residuals - CHANNELS, channels, follow)


def _same_motion(base: Loaded, other: Loaded) -> bool:
    """Whether two candidates predict the same motion and differ in their velocity logs at most."""
    return np.array_equal(base.model.program.flat, other.model.program.flat) and np.array_equal(
        base.memory, other.memory
    )


def _varied(base: Loaded, moved: Sequence[Loaded], shares: Array, logged: Sequence[int]) -> Varied:
    """Those parameters, but those of the log, whose effect on the motion the variational equation gives."""
    flat, states = base.model.program.flat, base.model.program.states
    of, kinds, where, programs, ahead = [], [], [], list[Array](), []
    place = 0
    for i, (other, share) in enumerate(zip(moved, shares, strict=True)):
        its = other.model.program.flat
        alike = np.array_equal(base.model.log, other.model.log)
        if i in logged or not alike or other.model.program.states != states:
            continue
        if not same_states(base.model.thrusters, other.model.thrusters):
            continue
        pair = changed_effects(flat, its)
        if pair is not None:
            kind = variational_equation.FORCES
        elif _thrust_alone(flat, its):
            kind, pair = variational_equation.THRUST, (its, its[:0])
        else:
            kind, pair = variational_equation.WHOLE, (its, its[:0])
        of.append(i)
        kinds.append(kind)
        middle = place + pair[0].size
        where.append([place, middle, middle, middle + pair[1].size])
        place = middle + pair[1].size
        programs += pair
        ahead.append((other.memory - base.memory) / share)
    return Varied(
        np.array(of, np.int64),
        np.array(kinds, np.int64),
        np.concatenate([*programs, np.zeros(0)]),
        np.array(where, np.int64).reshape(-1, 4),
        np.stack(ahead, axis=-1) if ahead else np.zeros((*base.memory.shape, 0)),
    )


def _thrust_alone(flat: Array, other: Array) -> bool:
    """Whether two programs of one length differ in nothing but their thruster tables."""
    begin = int(flat[THRUSTER_TABLE])
    return flat.size == other.size and np.array_equal(flat[:begin], other[:begin])


def _predicted(
    base: Loaded, varied: Varied, shares: Array, shots: Shots, part: slice, count: int
) -> tuple[Array, Array]:
    """Predicted states (s, length, 13), and columns (s, length, 12, 12 + P + 1), the first of them filled."""
    record, starts = shots.record, np.ascontiguousarray(shots.starts[part])
    states = np.empty((starts.size, shots.length, BODY))
    columns = np.empty((starts.size, shots.length, CHANNELS, CHANNELS + count + 1))
    variational_equation.vary(
        base.model.program.flat,
        varied.kinds,
        varied.programs,
        varied.where,
        shares[varied.of],
        record.commands,
        record.t,
        record.segments[shots.segment[part]],
        record.after_gap[shots.segment[part]],
        starts,
        multiple_shooting.substeps(record),
        np.ascontiguousarray(shots.first[part]),
        base.rotors[part],
        base.memory[part],
        np.ascontiguousarray(varied.ahead[part]),
        states,
        columns[..., : CHANNELS + len(varied.of)],
    )
    return states, columns


def _through_log(
    base: Loaded,
    moved: Sequence[Loaded],
    logged: Sequence[int],
    shares: Array,
    shots: Shots,
    states: Array,
    columns: Array,
    done: int,
) -> None:
    """What the log writes down of states and columns, and the columns of its own parameters.

    A reading is linear in the motion but for its bias.
    """
    log, clock = base.model.log, np.arange(shots.length) * shots.record.dt
    nu = np.nan_to_num(states[..., 7:], nan=1e6, posinf=1e6, neginf=-1e6)
    read = sensor.measured(log, clock, nu) if log.any() else nu
    for i, which in enumerate(logged, done):
        other = sensor.measured(moved[which].model.log, clock, nu)
        columns[:, :, :6, i] = 0.0
        columns[:, :, 6:, i] = (other - read) / shares[which]
    if log.any():
        unbiased = log.copy()
        unbiased[sensor.BIAS] = 0.0
        motion = np.nan_to_num(columns[:, :, 6:, :done]).transpose(0, 3, 1, 2)
        columns[:, :, 6:, :done] = sensor.measured(unbiased, clock, motion).transpose(0, 2, 3, 1)
        states[..., 7:] = read


def _again(
    still: Array,
    moved: Sequence[Loaded],
    rest: Sequence[int],
    shares: Array,
    shots: Shots,
    part: slice,
    columns: Array,
) -> None:
    """Columns of all other parameters, (s, K, 12, R): differences from the residual `still` (s, K, 12)."""
    for i, which in enumerate(rest):
        columns[..., i] = (still - multiple_shooting.residuals(moved[which], shots, None, part)) / shares[
            which
        ]


@jit
def _weigh(states: Array, measured: Array, weight: Array, columns: Array, error: Array) -> None:
    """Weighted residuals, and columns as weighted changes of the prediction in their sense.

    The attitude's residual e is twice the vector part of q_predicted^* q_measured = (a, e/2); the prediction
    turned by a small theta changes it by -(a theta + theta x e/2).
    """
    multiple_shooting.deviate(states, measured, weight, error)
    for m in range(states.shape[0]):
        for k in range(states.shape[1]):
            x, e = columns[m, k], error[m, k]
            a, b, c = 0.5 * e[3] / weight[3], 0.5 * e[4] / weight[4], 0.5 * e[5] / weight[5]
            whole = np.sqrt(max(1.0 - a * a - b * b - c * c, 0.0))
            for i in range(x.shape[1]):
                p, q, r = x[3, i], x[4, i], x[5, i]
                x[3, i] = whole * p + q * c - r * b
                x[4, i] = whole * q + r * a - p * c
                x[5, i] = whole * r + p * b - q * a
            for j in range(CHANNELS):
                for i in range(x.shape[1]):
                    x[j, i] *= weight[j]
