"""Sparse regression of accelerations with PySINDy (Brunton, Proctor and Kutz 2016; `pip install pysindy`).

    python -m benchmarks.rivals.sindy --studies 30 -o rivals.parquet

The library contains velocities, their signed squares, their products, the world's directions in body axes,
and the thrusts.  The residual acceleration of the file is regressed on it, and the family of terms with the
largest explained share is named.  A second regression, of the whole acceleration, gives predictions 5 s
ahead.
"""

from __future__ import annotations

import itertools
import warnings

import numpy as np
import polars as pl

from benchmarks.hidden_effects.build import build
from benchmarks.hidden_effects.plant import Array
from benchmarks.rivals.contest import Answer, Held, main, weighed
from benchmarks.rivals.regression import EDGE, EVERY, WRENCH
from hydro.core.distillation.labels import labels
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation

VELOCITY = ("u", "v", "w", "p", "q", "r")
THRESHOLD = 0.02
"""Minimum share of an axis' acceleration that a kept term explains."""
EXPLAINED = 0.1
"""Minimum share of the residual that the terms must explain for one to be named."""
PAIRS = tuple(itertools.combinations(range(6), 2))


def library(nu: Array, R: Array, thrusts: Array) -> Array:
    """Return the T library terms (N, T) of velocities (N, 6), rotations (N, 3, 3) and thrusts (N, n)."""
    products = [nu[:, i] * nu[:, j] for i, j in PAIRS]
    return np.hstack([nu, nu * np.abs(nu), np.stack(products, axis=1), R.reshape(-1, 9), thrusts])


def family(term: int, axis: int, thrusters: int) -> str:
    """Return the effect that a term represents in the equation of an axis."""
    kinds = (6, 6, len(PAIRS), 9, thrusters)
    kind = int(np.searchsorted(np.cumsum(kinds), term, side="right"))
    place = term - sum(kinds[:kind])
    match kind:
        case 0:
            return "linear_damping" if place == axis else "coupled_damping"
        case 1:
            return "quadratic_damping" if place == axis else "cross_axis_drag"
        case 2:
            return "body_lift" if 0 in PAIRS[place] else "added_mass_coriolis"
        case 3:
            down = place // 3 == 2  # rows of R are the world's axes as the body sees them
            return ("net_buoyancy" if axis < 3 else "buoyancy_offset") if down else "ocean_current"
        case _:
            return "thruster_gain"


def rms(values: Array) -> Array:
    """Return the root mean square of each column, which unlike a variance includes steady forces."""
    out: Array = np.sqrt(np.mean(values**2, axis=0))
    return out


def sparse(terms: Array, target: Array) -> Array:
    """Return the coefficients (A, T) of a sparse regression of `target` (N, A) on scaled terms."""
    import pysindy

    size, scale = rms(terms) + 1e-9, rms(target) + 1e-12
    names = [f"x{i}" for i in range(terms.shape[1])]
    model = pysindy.SINDy(
        optimizer=pysindy.STLSQ(threshold=THRESHOLD, alpha=1e-3), feature_library=pysindy.IdentityLibrary()
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a target without a remainder
        model.optimizer.fit(terms / size, target / scale)
    found: Array = np.asarray(model.optimizer.coef_) * scale[:, None] / size
    assert found.shape == (target.shape[1], len(names))
    return found


def answer(given: Vehicle, measured: pl.DataFrame) -> Answer:
    """Regress, name the family with the largest share, and predict with the whole regression."""
    plant, n = build(given), len(given.thruster)
    found = labels(given, measured, subtract="effects")
    thinned = pl.concat(
        [part[EDGE:-EDGE].gather_every(EVERY) for part in found.partition_by("session", maintain_order=True)]
    )
    terms = _terms(thinned, n)
    whole = thinned.select([f"{name}_dot" for name in VELOCITY]).to_numpy().astype(float)
    rest = thinned.select(WRENCH).to_numpy().astype(float) @ plant.inverse.T
    coefficients, weight = sparse(terms, rest), 1.0 / rms(whole) ** 2
    taken: dict[str, float] = {}
    left = rest - terms @ coefficients.T
    for axis, row in enumerate(coefficients):
        groups = [family(term, axis, n) for term in range(row.size)]
        for name in set(groups):
            mine = np.array([one == name for one in groups])
            more = rms(left[:, axis] + terms[:, mine] @ row[mine]) ** 2 - rms(left[:, axis]) ** 2
            taken[name] = taken.get(name, 0.0) + float(more * weight[axis])
    explained = 1.0 - float((rms(left) ** 2 * weight).sum() / (rms(rest) ** 2 * weight).sum())
    best = max(taken, key=lambda name: taken[name])
    model = sparse(terms, whole)
    return Answer(
        best if explained >= EXPLAINED else "",
        lambda errors, raw: error(model, given, errors, raw),
        lambda held: predicted(model, given, held),
    )


def _terms(table: pl.DataFrame, thrusters: int) -> Array:
    nu = table.select([f"{name}_s" for name in VELOCITY]).to_numpy().astype(float)
    R = rotation(*table.select("phi", "theta", "psi").to_numpy().astype(float).T)
    return library(nu, R, _thrusts(table, thrusters))


def _thrusts(table: pl.DataFrame, thrusters: int) -> Array:
    out: Array = table.select([f"f_{i + 1}" for i in range(thrusters)]).to_numpy().astype(float)
    return out


def error(model: Array, given: Vehicle, errors: Ahead, raw: pl.DataFrame) -> float:
    """Return the prediction error 5 s ahead on the held-out session."""
    held = Held.of(errors, raw)
    return weighed(errors, held.starts, predicted(model, given, held))


def predicted(model: Array, given: Vehicle, held: Held) -> Array:
    """Return the velocities (S, L, 6) of all predictions, integrated in parallel by Heun's method."""
    record, starts, length = held.record, held.starts, held.length
    thrusts = _thrusts(labels(given, held.raw, subtract="effects"), len(given.thruster))
    nu, R = held.nu[starts].copy(), rotation(*held.eta[starts, 3:].T)
    out = np.empty((starts.size, length, 6))
    with np.errstate(all="ignore"):  # divergence is counted as such
        for k in range(length):
            out[:, k] = nu
            f = thrusts[starts + k]
            first = library(nu, R, f) @ model.T
            ahead_R = turned(R, nu[:, 3:] * record.dt)
            second = library(nu + record.dt * first, ahead_R, f) @ model.T
            nu, R = np.clip(nu + 0.5 * record.dt * (first + second), -1e3, 1e3), ahead_R
    return out


def turned(R: Array, angle: Array) -> Array:
    """Rotate (S, 3, 3) by small rotation vectors (S, 3) in body axes (Rodrigues' formula)."""
    size = np.linalg.norm(angle, axis=1)[:, None, None] + 1e-12
    x, y, z = (angle / size[:, 0]).T
    zero = np.zeros_like(x)
    K = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    out: Array = R @ (np.eye(3) + np.sin(size) * K + (1.0 - np.cos(size)) * (K @ K))
    return out


if __name__ == "__main__":
    main("PySINDy", answer, __doc__ or "")
