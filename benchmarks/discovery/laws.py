"""Laws outside the catalogue: random generation, formulas, and comparison with discovered terms."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from hydro.core.columns import VELOCITY
from hydro.core.effects.formula import AXES, amounts, one_term
from hydro.core.vehicle.description import Vehicle

KINDS = ("power off CO", "power on another axis", "product", "raised drag", "threshold")
CLOSE = 0.3
"""Maximum error of a power."""
Law = tuple[str, list[list[float]], list[dict[str, Any]]]


def law(seed: int, vehicle: Vehicle, rng: np.random.Generator) -> Law:
    """Draw a law outside the catalogue.

    Returns:
        Kind of the law, its rows of `Plant.laws`, and the law as tables of the effect `formula`.
    """
    kind, m = KINDS[seed % len(KINDS)], vehicle.rigid_body.mass
    arm = float(np.sqrt(np.trace(np.array(vehicle.rigid_body.inertia)) / 3.0 / m))
    size, power = float(rng.uniform(0.3, 1.5)), float(rng.uniform(1.3, 3.0))
    if kind == "power off CO":
        axis, turned, way = ((1, 5, 1.0), (2, 4, -1.0), (1, 3, -1.0))[int(rng.integers(3))]
        amount = -size * m
        lever = way * float(rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.3)) * (0.3 if turned == 3 else 1.0)
        pairs = [(axis, amount), (turned, amount * lever * arm / 0.3)]
        return (
            kind,
            [[a, c, axis, power, 0, -1, 0, 0] for a, c in pairs],
            [odd(a, c, axis, power) for a, c in pairs],
        )
    if kind == "power on another axis":
        axis, cause = ((3, 1), (4, 0), (4, 2), (5, 1), (2, 0), (2, 4))[int(rng.integers(6))]
        amount = float(rng.choice([-1.0, 1.0])) * size * m * (0.3 * arm if axis > 2 else 0.3)
        return kind, [[axis, amount, cause, power, 0, -1, 0, 0]], [odd(axis, amount, cause, power)]
    if kind == "product":
        axis, one, other = ((2, 0, 4), (1, 0, 5), (3, 1, 5), (5, 0, 3), (4, 0, 2))[int(rng.integers(5))]
        amount = float(rng.choice([-1.0, 1.0])) * size * m * (0.3 * arm if axis > 2 else 1.0)
        text = f"{AXES[axis]} {VELOCITY[one]} {VELOCITY[other]}"
        return kind, [[axis, amount, one, 1, 0, other, 1, 1]], [one_term(text, amount)]
    if kind == "raised drag":
        axis, cause = ((0, 5), (1, 5), (5, 0), (5, 1), (4, 2), (0, 4))[int(rng.integers(6))]
        raised = float(rng.uniform(0.6, 1.6))
        amount = -size * m * (arm**2 if axis > 2 else 1.0) * (2.0 if cause > 2 else 1.0)
        text = f"{AXES[axis]} |{VELOCITY[cause]}|^n {VELOCITY[axis]}"
        return kind, [[axis, amount, axis, 1, 0, cause, raised, 0]], [one_term(text, amount, [raised])]
    axis, cause = ((5, 1), (4, 0), (2, 0), (3, 1))[int(rng.integers(4))]
    amount = float(rng.choice([-1.0, 1.0])) * size * m * (0.5 * arm if axis > 2 else 0.5)
    least = float(rng.uniform(0.05, 0.2))
    return kind, [[axis, amount, cause, 1, least, -1, 0, 0]], [odd(axis, amount, cause, 1.5)]


def odd(axis: int, amount: float, cause: int, power: float) -> dict[str, Any]:
    """Return a formula term: `amount` times |v|^power with the sign of v, the velocity of axis `cause`."""
    return one_term(f"{AXES[axis]} |{VELOCITY[cause]}|^n sgn({VELOCITY[cause]})", amount, [power])


def form(table: Mapping[str, Any]) -> dict[tuple[Any, ...], float]:
    """Return the total power of each term of a formula, by axis, velocities and whether each is odd.

    Drag of an axis by its own velocity is left out, because the file's damping may absorb it.
    """
    found = {}
    for text, _, free in amounts(table):
        axis, *factors = text.split()
        powers, signs, left = dict[str, float](), dict[str, int](), list(free)
        for factor in factors:
            name = re.findall(r"[a-z_]+", factor.replace("sgn", "").replace("^n", ""))[0]
            signed = not factor.startswith("|")
            power = 0.0 if factor.startswith("sgn") else left.pop(0) if factor.endswith("^n") else 1.0
            powers[name] = powers.get(name, 0.0) + power
            signs[name] = (signs.get(name, 0) + signed) % 2
        own = VELOCITY[AXES.index(axis)]
        if list(powers) == [own] and signs[own]:
            continue  # the file's damping may absorb it
        key = (axis, tuple(sorted((name, signs[name]) for name in powers)))
        found[key] = sum(powers.values())
    return found


def right(
    truth: Mapping[str, Any], table: Mapping[str, Any], one_way: Sequence[str], *, powers: bool
) -> bool:
    """Return whether a formula has exactly the true terms, and with `powers` also about the true powers.

    Args:
        truth: Table of the true formula.
        table: Table of the discovered formula.
        one_way: Velocities that have one sign throughout; for them odd and even terms count as equal.
        powers: Whether powers must agree too.
    """
    expected, got = (
        {
            (axis, tuple((name, odd and name not in one_way) for name, odd in factors)): power
            for (axis, factors), power in form(one).items()
        }
        for one in (truth, table)
    )
    near = all(abs(expected[key] - got[key]) <= CLOSE for key in expected.keys() & got.keys())
    return expected.keys() == got.keys() and (near or not powers)


def ahead_only(raw: pl.DataFrame) -> list[str]:
    """Return the names of the velocities that have almost always the same sign in a recording."""
    motion = raw.select(VELOCITY).to_numpy()
    ways = np.stack([(np.abs(motion) * (motion * way > 0.0)).sum(axis=0) for way in (-1.0, 1.0)])
    return [
        name
        for name, less, all_ in zip(VELOCITY, ways.min(axis=0), ways.sum(axis=0), strict=True)
        if less < 0.02 * all_
    ]
