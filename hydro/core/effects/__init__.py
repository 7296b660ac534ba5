"""The catalogue of physical effects: one family per file, one record and one kernel per effect."""

from __future__ import annotations

from hydro.core.effects.catalogue import CATALOGUE, added_mass_matrix, inertia_matrix
from hydro.core.effects.record import Effect, Parameter
from hydro.core.effects.validate import validate

__all__ = ["CATALOGUE", "Effect", "Parameter", "added_mass_matrix", "inertia_matrix", "validate"]
