"""Changes of each study: drawn from its kind and seed alone, not from the order of the work."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.hidden_effects import vehicles
from benchmarks.hidden_effects.cases import ATTEMPTS, BY_LAW, NEWEST, Case, times
from benchmarks.imperfect_base.base import DEPTH
from benchmarks.recovery import TRUTHS, Draw
from hydro.core.effects import CATALOGUE, validate
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle

KINDS = ("changed", "nothing")
SMALLEST, LARGEST = 0.5, 4.0
"""Bounds of the factor on a change's usual size, drawn log-uniformly."""
NEAR_SURFACE = 1.5  # m, where the surface pulls


def one_thruster(rng: np.random.Generator, vehicle: Vehicle) -> dict[str, Any]:
    """Draw a loss of thrust of one thruster, as an effect's table."""
    gains = np.zeros(len(vehicle.thruster))
    gains[rng.integers(gains.size)] = -rng.uniform(0.2, 0.4)
    return {"g": gains.tolist()}


def payload_at_bow(rng: np.random.Generator, vehicle: Vehicle) -> dict[str, Any]:
    """Draw a heavy payload under the bow, as an effect's table."""
    mass = float(rng.uniform(0.02, 0.06)) * vehicle.rigid_body.mass
    place = {"x": 0.4 * vehicle.hull.length, "y": 0.0, "z": 0.3 * vehicle.hull.height}
    return {"w": 0.15 * 9.81 * mass, "mass": mass, **place}


CHANGES: dict[str, tuple[str, Draw]] = {
    **{name: (name, TRUTHS[name]) for name in BY_LAW if name not in NEWEST},
    "one weak thruster": ("thruster_gain", one_thruster),
    "payload at the bow": ("payload", payload_at_bow),
}
"""Name of each change: the effect that should be named, and its table at its usual size."""


def draw(kind: str, seed: int) -> Case:
    """Draw the case of a kind and seed; successive seeds go through the changes in turn.

    Raises:
        DataError: No vehicle can have the change, or the catalogue has an effect that is not a formula.
    """
    require_formulas()
    rng = np.random.default_rng([seed, KINDS.index(kind), 19])
    title = list(CHANGES)[seed % len(CHANGES)] if kind == "changed" else ""
    for _ in range(ATTEMPTS):
        preset = str(rng.choice(vehicles.PRESETS))
        vehicle = vehicles.preset(preset)
        hidden: tuple[dict[str, Any], ...] = ()
        if title:
            name, usual = CHANGES[title]
            factor = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
            hidden = (times({"name": name, **usual(rng, vehicle)}, factor),)
        try:
            validate(vehicles.joined(vehicle, hidden))
        except DataError:
            continue
        depth = NEAR_SURFACE if title == "surface_suction" else DEPTH
        called = tuple(str(table["name"]) for table in hidden)
        return Case(kind, seed, preset, "teacher", 1.0, depth, hidden, called=called, title=title)
    raise DataError(f"no vehicle can have what seed {seed} changes")


def require_formulas() -> None:
    """Refuse a catalogue with the panels of the reference simulator as an effect: the base would be exact.

    Raises:
        DataError: An effect's records name panels, facets or a mesh.
    """
    for name, effect in CATALOGUE.items():
        if any(
            word in f"{name} {effect.definition} {effect.family}".lower()
            for word in ("panel", "facet", "mesh")
        ):
            raise DataError(f"{name} is an effect of panels: it may not be among the candidates here")
