"""The catalogue of physical effects: one family per file, one record and one kernel per effect."""

from __future__ import annotations

from hydro.core.effects.catalogue import (
    CATALOGUE,
    added_mass_matrix,
    current,
    inertia_matrix,
    thruster_table,
    velocity_log,
)
from hydro.core.effects.columns import effect_forces, effect_wrenches
from hydro.core.effects.program import Program, assemble
from hydro.core.effects.record import Effect, Parameter
from hydro.core.effects.validate import validate

__all__ = [
    "CATALOGUE",
    "Effect",
    "Parameter",
    "Program",
    "added_mass_matrix",
    "assemble",
    "current",
    "effect_forces",
    "effect_wrenches",
    "inertia_matrix",
    "thruster_table",
    "validate",
    "velocity_log",
]
