"""Scores of every candidate effect that a diagnosis fitted, kept so that its decisions can be checked.

A diagnosis decides in steps: at each step it fits several candidates and takes the best.  A `Candidate` holds
the numbers that such a decision uses, so that the decision can be repeated with other settings and no new fit
(`benchmarks.judge`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.catalogue import implausible
from hydro.core.evaluation.block_resampling import block_sums
from hydro.core.vehicle.description import Vehicle

Engine = Literal["likelihood", "change", "transfer"]
BLOCKS = 24
"""Maximum number of blocks of consecutive shots whose costs are kept, which bounds the table.  With more
blocks a resampled frequency changes by less than its scatter."""


@dataclass(frozen=True)
class Candidate:
    """One effect at one step of a search, with the numbers that decide about it.

    Attributes:
        engine: Search that fitted the effect: `likelihood` for files that reach the noise, `change` with an
            earlier recording, `transfer` for files that do not reach the noise.
        step: Number of the step, from 0.
        effect: Name; empty for the model without any candidate.
        chosen: Whether the diagnosis took the effect.
        entries: Number of fitted values, including those of the file's free effects.
        shots: Number of shots behind the costs.
        costs: Squared residual in each block of consecutive shots, at most BLOCKS; empty for an engine that
            does not rank by it.
        chi2: Mean squared residual in units of the noise, or of the floor of the hull model for `change`.
        residuals: Number of residuals, or the floor of the hull model in the unit of `costs` for `change`.
        left_out: Share of the held-out error that the effect removes; NaN if the engine does not compute it.
        evidence: Log evidence beyond that of the file; NaN if the engine does not compute it.
        lead: Evidence less the part that does not count in a comparison with the next candidate, see
            `transfer.Rival.lead`; NaN if the engine does not compute it.
        own: Whether the file has the effect already.
        absorbs: Share of the held-out error that the effect removes from a hull that no formula describes, if
            nothing else is missing.
        plausible: Whether the values lie within their plausible range.
        values: Fitted values of the effect's table.
    """

    engine: Engine
    step: int
    effect: str
    chosen: bool
    entries: int
    shots: int = 0
    costs: Array = field(default_factory=lambda: np.zeros(0))
    chi2: float = math.nan
    residuals: float = math.nan
    left_out: float = math.nan
    evidence: float = math.nan
    lead: float = math.nan
    own: bool = False
    absorbs: float = 0.0
    plausible: bool = True
    values: Mapping[str, Any] = field(default_factory=dict)


def in_blocks(costs: Array, size: int = 1) -> Array:
    """Sum the costs of S shots over blocks of consecutive shots.

    Args:
        costs: Squared residual of each shot, (S,).
        size: Number of which the length of a block is a multiple.

    Returns:
        Sum of each of B blocks, (B,), at most BLOCKS.
    """
    least = -(-len(costs) // BLOCKS)
    whole = max(-(-least // size), 1) * size
    return block_sums(costs[:, None], whole)[:, 0]


def candidate_of(
    engine: Engine, step: int, effect: str, vehicle: Vehicle, *, chosen: bool, entries: int, **numbers: Any
) -> Candidate:
    """Return a candidate with the values of a fitted vehicle.

    Args:
        engine: Search that fitted the effect.
        step: Number of the step.
        effect: Name; empty for the model without any candidate.
        vehicle: Fitted vehicle.
        chosen: Whether the diagnosis took the effect.
        entries: Number of fitted values.
        numbers: Further attributes of the candidate.
    """
    tables = vehicle.effects(effect) if effect else ()
    values = {key: value for key, value in tables[0].items() if key != "name"} if tables else {}
    plausible = not effect or not implausible(vehicle, [effect])
    return Candidate(engine, step, effect, chosen, entries, plausible=plausible, values=values, **numbers)
