"""Catalogue of physical effects: one family per file, one record and one kernel per effect.

Names are loaded at their first use, so that `core.effects.examples` loads nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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
    from hydro.core.effects.sums import validate

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

_MODULES = ("record", "catalogue", "columns", "program", "sums")

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Load a name from the first module that defines it."""
        if name in __all__:
            for module in _MODULES:
                found = import_module(f"{__name__}.{module}")
                if hasattr(found, name):
                    globals()[name] = getattr(found, name)
                    return globals()[name]
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
