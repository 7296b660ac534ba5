"""Scores of every candidate effect that a diagnosis fitted, kept so that its decisions can be repeated.

A diagnosis decides in steps: at each step it fits several candidates and takes the best.  A row holds the
numbers that such a decision uses, so that it can be repeated with other settings and no new fit (`rescore`):

| column | meaning |
|---|---|
| `engine` | regime: `likelihood`, `change` with an earlier recording, or `transfer` (`by_evidence`) |
| `step` | number of the step, from 0 |
| `effect` | name; empty for the model without any candidate |
| `chosen` | whether the diagnosis took the effect |
| `entries`, `shots` | numbers of fitted values, and of shots behind the costs |
| `costs` | squared residual in each block of consecutive shots; empty for `transfer` |
| `chi2` | mean squared residual in units of the noise, or of the floor of the hull model for `change` |
| `residuals` | number of residuals, or the floor of the hull model in the unit of `costs` for `change` |
| `left_out` | share of the held-out error that the effect removes |
| `evidence`, `lead` | log evidence beyond that of the file, and the part that counts, see `transfer.Rival` |
| `own` | whether the file has the effect already |
| `absorbs` | share of the held-out error of a hull that no formula describes which the effect removes |
| `plausible`, `values` | whether the values lie within their plausible range, and the values |
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from hydro.core.columns import Array
from hydro.core.diagnosis.baseline import Outcome
from hydro.core.diagnosis.by_change import ByChange, Change, Changes
from hydro.core.diagnosis.by_evidence import ByEvidence, Named
from hydro.core.diagnosis.by_likelihood import ByLikelihood
from hydro.core.diagnosis.contenders import Contender
from hydro.core.diagnosis.findings import Diagnosis
from hydro.core.diagnosis.model import Model
from hydro.core.effects.catalogue import CATALOGUE, implausible
from hydro.core.evaluation.block_resampling import block_sums
from hydro.core.prediction.normal_equations import block_length
from hydro.core.vehicle.description import Vehicle

Row = dict[str, Any]
BLOCKS = 24
"""Maximum number of blocks of consecutive shots whose costs are kept, which bounds the table.  With more
blocks a resampled frequency changes by less than its scatter."""


def candidates(found: Diagnosis) -> Iterator[Row]:
    """Yield every candidate of a diagnosis, step by step; none where the log has a fault."""
    match found.trace:
        case (ByLikelihood() as regime, Outcome() as outcome):
            yield from _by_likelihood(regime, outcome)
        case (ByChange() as regime, Changes() as changes):
            yield from of_changes(regime, changes)
        case (ByEvidence(), Named() as named):
            yield from _by_transfer(named)


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


def _row(engine: str, step: int, effect: str, vehicle: Vehicle, chosen: bool, **numbers: Any) -> Row:
    """Return a row with the values of the fitted vehicle."""
    tables = vehicle.effects(effect) if effect else ()
    values = {key: value for key, value in tables[0].items() if key != "name"} if tables else {}
    plausible = not effect or not implausible(vehicle, [effect])
    fixed = {"engine": engine, "step": step, "effect": effect, "chosen": chosen, "plausible": plausible}
    return {"shots": 0, "costs": [], "absorbs": 0.0, "own": False} | fixed | {"values": values} | numbers


def _by_likelihood(regime: ByLikelihood, outcome: Outcome) -> Iterator[Row]:
    """Yield the candidates of a search by likelihood, and at each step the model without a new effect."""
    baseline = regime.search.baseline
    without, size = baseline.refitted, 2

    def row(step: int, name: str, model: Model, chosen: bool) -> Row:
        return _row(
            "likelihood",
            step,
            name,
            model.vehicle,
            chosen,
            entries=len(model.values),
            shots=len(model.costs),
            costs=in_blocks(model.costs, size).tolist(),
            chi2=model.normal.chi2,
            residuals=model.normal.residuals,
            own=bool(name) and bool(baseline.vehicle.effects(name)),
        )

    for step, one in enumerate(outcome.found):
        size = max(block_length(one.model.normal.score), 2)
        yield row(step, "", without, False)
        for name, model in one.rivals.items():
            yield row(step, name, model, model is one.model)
        without = one.model
    yield row(len(outcome.found), "", without, True)


def of_changes(regime: ByChange, changes: Changes) -> Iterator[Row]:
    """Yield the candidates of a search for changes, and at each step the model without a further change."""
    last = regime.first

    def row(step: int, change: Change, rival: Contender, chosen: bool) -> Row:
        name = rival.effect
        return _row(
            "change",
            step,
            name,
            rival.model.vehicle,
            chosen,
            entries=len(rival.model.values),
            shots=len(rival.costs),
            costs=in_blocks(rival.costs).tolist(),
            chi2=regime.compared.chi2(rival.model),
            residuals=change.floor,
            left_out=float(1.0 - rival.left / change.whole.sum()),
            own=bool(name) and bool(regime.first.vehicle.effects(name)),
            absorbs=CATALOGUE[name].identification.absorbs if name else 0.0,
        )

    for step, change in enumerate([*changes.found, *([changes.refused] if changes.refused else [])]):
        taken = step < len(changes.found)
        yield row(step, change, Contender("", last, change.whole), not taken)
        for name, rival in change.rivals.items():
            yield row(step, change, rival, taken and name == change.best.effect)
        last = change.best.model


def _by_transfer(named: Named) -> Iterator[Row]:
    """Yield every effect of a survey, the best first."""
    chosen = named.findings[0].effect if named.findings else ""
    for rival in named.rivals:
        weighed = {} if rival.allowed is None else {"evidence": rival.evidence, "lead": rival.lead}
        yield _row(
            "transfer",
            0,
            rival.effect,
            rival.model.unknown.at(rival.values),
            rival.effect == chosen,
            entries=rival.entries,
            chi2=rival.model.normal.chi2,
            left_out=rival.score,
            own=rival.own,
            absorbs=rival.absorbs,
            **weighed,
        )
