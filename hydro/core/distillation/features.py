"""Features of residual networks, computed from velocity nu and acceleration nu_dot; paper (4), section III-C.

The set `physfeat` has 45 features, so the network 45-128-256-128-6 has 72,582 parameters, the paper's "73K":

* nu (6) and nu_dot (6): linear damping, and inertia that the label's constant M does not contain;
* nu_i |nu_i| (6): quadratic drag;
* nu_i nu_j, i < j (15): all Coriolis and centripetal terms, including the Munk moments;
* |nu_i| nu_j (12): even in the first and odd in the second velocity, as a dissipative force must be.

The last kind has 30 pairs, of which twelve are used.  Each translation is damped by the other two: form drag
grows with the total speed |V|, so |w| u matters as much as |u| u on a bluff hull; |u| v and |u| w are also
lift.  Yaw is damped by surge, sway and heave, and pitch by surge and heave (fins and the cross-flow
integrals, Fossen 6.4.3).  Roll is damped by heave, which is normal to the broad side of a hull that is wider
than high.
"""

from __future__ import annotations

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from hydro.core.columns import VELOCITY, WRENCH, Array
from hydro.core.compiled import jit, kernel
from hydro.core.distillation.labels import labelled
from hydro.core.errors import DataError

INPUTS = (*(f"{name}_s" for name in VELOCITY), *(f"{name}_dot" for name in VELOCITY))
"""Columns of a labels table with smoothed velocity nu and acceleration nu_dot."""
OUTPUTS = tuple(f"{name}_res" for name in WRENCH)
"""Columns of a labels table that networks predict: the residual wrench X_res to N_res [N, N m]."""

CROSS = np.array(  # pairs (i, j) of the features |nu_i| nu_j
    [(1, 0), (2, 0), (0, 1), (2, 1), (0, 2), (1, 2), (2, 3), (0, 4), (2, 4), (0, 5), (1, 5), (2, 5)]
)
_CROSS_FIRST, _CROSS_SECOND = CROSS[:, 0].copy(), CROSS[:, 1].copy()

_RAW = (*VELOCITY, *(f"{name}_dot" for name in VELOCITY))
_PHYSFEAT = (
    *_RAW,
    *(f"{name}|{name}|" for name in VELOCITY),
    *(VELOCITY[i] + VELOCITY[j] for i in range(6) for j in range(i + 1, 6)),
    *(f"|{VELOCITY[i]}|{VELOCITY[j]}" for i, j in CROSS),
)
NAMES: dict[str, tuple[str, ...]] = {"raw": _RAW, "physfeat": _PHYSFEAT}
"""Names of the features, by feature set."""


@kernel
def physfeat_kernel(x: Array, out: Array) -> None:
    """Write the 45 features of a state x = (nu, nu_dot), velocity and acceleration in body axes, to `out`.

    Args:
        x: State, (12,) [m/s, rad/s, m/s^2, rad/s^2].
        out: Output: velocities, accelerations and products of velocities, in the order of `names`, (45,).
    """
    for i in range(12):
        out[i] = x[i]
    for i in range(6):
        out[12 + i] = x[i] * abs(x[i])
    at = 18
    for i in range(6):
        for j in range(i + 1, 6):
            out[at] = x[i] * x[j]
            at += 1
    for k in range(12):
        out[33 + k] = abs(x[_CROSS_FIRST[k]]) * x[_CROSS_SECOND[k]]


@jit
def _physfeat_columns(states: Array, out: Array) -> None:
    """Write the features of many states (N, 12) to `out` (N, 45)."""
    for k in range(states.shape[0]):
        physfeat_kernel(states[k], out[k])


def names(feature_set: str) -> tuple[str, ...]:
    """Return the names of the features of a set, in order, such as u, u_dot, u|u|, uv, |v|u.

    u v w p q r are smoothed velocities, u_dot ... r_dot accelerations, both in body axes.

    Args:
        feature_set: `raw` (velocity nu and acceleration nu_dot) or `physfeat` (also products of velocities).

    Raises:
        DataError: The set is unknown.
    """
    if feature_set not in NAMES:
        raise DataError(f"feature set {feature_set!r} is not known; choose one of {', '.join(NAMES)}")
    return NAMES[feature_set]


def features(states: ArrayLike, feature_set: str = "physfeat") -> Array:
    """Return the features of N states.

    Args:
        states: Velocity and acceleration (nu, nu_dot) in body axes, (N, 12) [m/s, rad/s, m/s^2, rad/s^2].
        feature_set: `raw`, the states themselves, or `physfeat`, also products of velocities.

    Returns:
        Features in the order of `names`, (N, len(names(feature_set))).

    Raises:
        DataError: The set is unknown.
    """
    x = np.ascontiguousarray(states, dtype=np.float64).reshape(-1, len(INPUTS))
    if len(names(feature_set)) == len(INPUTS):
        return x
    out = np.empty((x.shape[0], len(_PHYSFEAT)))
    _physfeat_columns(x, out)
    return out


def table(labels: pl.DataFrame, feature_set: str = "physfeat") -> pl.DataFrame:
    """Return the training table of a network: features and targets of every row with a label.

    Args:
        labels: Labels table, or the same table after `split`.
        feature_set: `raw` (velocity and acceleration) or `physfeat` (also products of velocities).

    Returns:
        A new table with the columns `session`, `t` [s]; `block` and `part` if the table was split; the
        features as float32 columns, named by `names`; and the targets, the residual wrench tau_res, as
        OUTPUTS [N, N m].

    Raises:
        DataError: The set is unknown, or the table lacks a column.
    """
    missing = [name for name in ("session", "t", *INPUTS, *OUTPUTS) if name not in labels.columns]
    if missing:
        raise DataError(f"the table lacks {', '.join(missing)}; make it with `hydro labels`")
    labels = labelled(labels)
    kept = [name for name in ("session", "t", "block", "part") if name in labels.columns]
    values = features(labels.select(INPUTS).to_numpy(), feature_set).astype(np.float32)
    made = pl.DataFrame(values, schema=list(names(feature_set)))
    return pl.concat([labels.select(kept), made, labels.select(OUTPUTS)], how="horizontal")
