"""Processor time of a formula compared with the built-in kernel of the same terms, in alternation.

python -m benchmarks.formula_speed
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from benchmarks.hidden_effects.vehicles import preset
from hydro.core.columns import VELOCITY
from hydro.core.effects import effect_wrenches
from hydro.core.effects.formula import AXES, joined, one_term

ROWS, ROUNDS = 200_000, 15


def quadratic() -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Return tables of quadratic damping, the same as a formula, and that formula with free powers."""
    sizes = [10.0, 20.0, 30.0, 4.0, 5.0, 6.0]
    same = [one_term(f"{AXES[i]} |{VELOCITY[i]}| {VELOCITY[i]}", -sizes[i]) for i in range(6)]
    free = [one_term(f"{AXES[i]} |{VELOCITY[i]}|^n sgn({VELOCITY[i]})", -sizes[i], [2.1]) for i in range(6)]
    return {"name": "quadratic_damping", "diagonal": sizes}, joined(same), joined(free)


def across() -> tuple[dict[str, Any], dict[str, Any]]:
    """Return tables of cross-axis drag with fifteen terms, and the same as a formula."""
    pairs = [(i, j) for i in range(6) for j in range(3) if i != j]
    same = [one_term(f"{AXES[i]} |{VELOCITY[j]}| {VELOCITY[i]}", -1.0) for i, j in pairs]
    return {"name": "cross_axis_drag", **{f"D{i}{j}": 1.0 for i, j in pairs}}, joined(same)


def seconds(tables: list[Mapping[str, Any]]) -> np.ndarray:
    """Return the processor time of the wrench of each table, (ROUNDS, effects), measured in alternation."""
    nu, still = np.random.default_rng(0).standard_normal((ROWS, 6)), np.zeros((ROWS, 6))
    t = 0.02 * np.arange(ROWS)
    vehicles = [msgspec.structs.replace(preset("auv151"), effect=(table,)) for table in tables]
    taken = []
    for _ in range(ROUNDS + 1):
        row = []
        for vehicle in vehicles:
            begun = time.process_time()
            effect_wrenches(vehicle, still, nu, [[0, ROWS]], t)
            row.append(time.process_time() - begun)
        taken.append(row)
    return np.array(taken[1:])


def main() -> None:
    for name, tables in (("quadratic_damping", quadratic()), ("cross_axis_drag", across())):
        taken = seconds(list(tables))
        ratios = taken[:, 1:] / taken[:, :1]
        low, middle, high = np.quantile(ratios, [0.25, 0.5, 0.75], axis=0)
        for column, what in enumerate(("the same terms", "with powers of its own")[: ratios.shape[1]]):
            span = f"{middle[column]:.2f} ({low[column]:.2f} to {high[column]:.2f})"
            print(f"{name}, {what}: {span} times, quartiles of {ROUNDS} interleaved rounds")


if __name__ == "__main__":
    main()
