"""Inputs of the residual networks, made from the twelve numbers (nu, nu_dot); paper (4) and section III-C.

The set `physfeat` holds 45 features, so that 45-128-256-128-6 has the 72,582 parameters of the paper's "73K":

* nu (6) and nu_dot (6): linear damping and the inertia that the label's constant M leaves out;
* nu_i |nu_i| (6): quadratic drag;
* nu_i nu_j, i < j (15): every Coriolis and centripetal term is such a product, the Munk moments included;
* |nu_i| nu_j (12), even in the first and odd in the second velocity as a dissipative force must be.

Of the 30 pairs of the last kind these twelve are taken: each translation damped by the other two (form drag
grows with the whole speed |V|, so that |w| u counts as much as |u| u on a bluff hull; |u| v and |u| w are
lift as well); yaw damped by surge, sway and heave and pitch by surge and heave (fins and the cross-flow
integrals, Fossen 6.4.3); and roll by heave, at right angles to the broad side of a hull wider than high.
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
OUTPUTS = tuple(f"{name}_res" for name in WRENCH)

CROSS = np.array(  # (i, j) of |nu_i| nu_j
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


@kernel
def physfeat_kernel(x: Array, out: Array) -> None:
    """Write the 45 features of one state `x` = (nu, nu_dot), shape (12,), to `out`, shape (45,)."""
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
    for k in range(states.shape[0]):
        physfeat_kernel(states[k], out[k])


def names(feature_set: str) -> tuple[str, ...]:
    """Names of a set's features in their order, such as u, u_dot, u|u|, uv, |v|u; u is the smoothed velocity.

    Raises:
        DataError: No set has this name.
    """
    if feature_set not in NAMES:
        raise DataError(f"feature set {feature_set!r} is not known; choose one of {', '.join(NAMES)}")
    return NAMES[feature_set]


def features(states: ArrayLike, feature_set: str = "physfeat") -> Array:
    """Features of many states.

    Args:
        states: (nu, nu_dot) in body axes, shape (N, 12) [m/s, rad/s, m/s^2, rad/s^2].
        feature_set: `raw`, the states themselves, or `physfeat`.

    Returns:
        Features, shape (N, len(names(feature_set))).

    Raises:
        DataError: No set has this name.
    """
    x = np.ascontiguousarray(states, dtype=np.float64).reshape(-1, len(INPUTS))
    if len(names(feature_set)) == len(INPUTS):
        return x
    out = np.empty((x.shape[0], len(_PHYSFEAT)))
    _physfeat_columns(x, out)
    return out


def table(labels: pl.DataFrame, feature_set: str = "physfeat") -> pl.DataFrame:
    """Features of a labels or split table beside its `session`, `t`, targets, and `block` and `part` if any.

    Features are float32 columns named by `names`; targets are tau_res [N, N m].  Rows without a label are
    left out.

    Raises:
        DataError: No set has this name, or the table lacks a column.
    """
    missing = [name for name in ("session", "t", *INPUTS, *OUTPUTS) if name not in labels.columns]
    if missing:
        raise DataError(f"the table lacks {', '.join(missing)}; make it with `hydro labels`")
    labels = labelled(labels)
    kept = [name for name in ("session", "t", "block", "part") if name in labels.columns]
    values = features(labels.select(INPUTS).to_numpy(), feature_set).astype(np.float32)
    made = pl.DataFrame(values, schema=list(names(feature_set)))
    return pl.concat([labels.select(kept), made, labels.select(OUTPUTS)], how="horizontal")
