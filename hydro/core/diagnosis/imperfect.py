"""What is said where no model reaches the noise: the change that transfers best, and how far to believe it.

A hull has no exact form in the catalogue, and many a formula bends to what it leaves.  So one change at a
time is named, by what it removes of data that it was not fitted to (`diagnosis.transfer`); the rest is the
hull's own error until a recording from before the change parts the two.
"""

from __future__ import annotations

from dataclasses import dataclass

from hydro.core.columns import Progress
from hydro.core.diagnosis.confidence import by_transfer_confidence, explained_share
from hydro.core.diagnosis.findings import SURE, Finding
from hydro.core.diagnosis.model import Diverges, Model, fit_model
from hydro.core.diagnosis.search import Baseline
from hydro.core.diagnosis.transfer import Known, Rival, Survey, survey, tempered
from hydro.core.experiment import advice
from hydro.core.identification.fit import Fit, with_uncertainty
from hydro.core.identification.normal_equations import block_length
from hydro.core.identification.prior import greatest_change

NAMED = 0.05
"""Share of the error of left-out data that an effect must remove to be named at all."""
MOVED = 2.0
"""Standard deviations of what is known of a value by which a fit must move it to be a finding."""
STEPS = 12
"""Of the last fit."""


@dataclass(frozen=True)
class Named:
    """What transfers best.

    Attributes:
        findings: One naming, or none.
        model: The vehicle with it and the file's own effects, fitted within what is known of them.
        fit: Values and standard errors; None where nothing was fitted.
        refitted: The file's own effects alone, likewise.
    """

    findings: tuple[Finding, ...]
    model: Model
    fit: Fit | None
    refitted: Model


def by_transfer(baseline: Baseline, progress: Progress | None = None) -> Named:
    """Name the change that removes most of the error of data that it was not fitted to."""
    surveyed = survey(baseline, progress)
    refitted, known = tempered(baseline.vehicle, baseline.effects, baseline.problem, baseline.log.positions)
    for place, rival in enumerate(surveyed.rivals):
        if rival.score < NAMED:
            break
        if rival.own and not _moved(rival, baseline):
            continue
        try:
            model = _to_the_end(rival, baseline, known)
        except Diverges:
            continue
        fit = with_uncertainty(model.unknown, model.values, model.normal, model.normal.chi2, "output")
        finding = _finding(rival, surveyed, place, baseline, model, fit, refitted)
        return Named((finding,), model, fit, refitted)
    return Named((), refitted, None, refitted)


def _moved(rival: Rival, baseline: Baseline) -> bool:
    """Whether the fit of an effect of the file moves it farther than what is known of it allows for."""
    unknown = rival.model.unknown
    own = [i for i, entry in enumerate(unknown.entries) if entry.effect == rival.effect]
    entries = [unknown.entries[i] for i in own]
    return greatest_change(baseline.vehicle, entries, rival.model.values[own]).deviations >= MOVED


def _to_the_end(rival: Rival, baseline: Baseline, known: Known) -> Model:
    """The effect and the file's own fitted to all shots, from the values of the survey."""
    table = next(iter(rival.model.vehicle.effects(rival.effect)))
    released = Known(baseline.vehicle, known.temper, frozenset({rival.effect}))
    others = [name for name in baseline.effects if name != rival.effect]
    reach = baseline.log.positions
    return fit_model(rival.model.vehicle, [*others, table], baseline.problem, reach, STEPS, known=released)


def _finding(
    rival: Rival,
    surveyed: Survey,
    place: int,
    baseline: Baseline,
    model: Model,
    fit: Fit,
    refitted: Model,
) -> Finding:
    """The naming, with its share of the error beyond the noise that the file's own effects leave."""
    pieces = max(block_length(model.normal.score), 1)
    share, low, high = explained_share(refitted.costs - model.costs, refitted.excesses, pieces)
    table = next(one for one in fit.tables() if one["name"] == rival.effect)
    values = {k: v for k, v in table.items() if k not in ("name", "standard_error") and v is not None}
    others = [one for one in surveyed.rivals if one is not rival]
    sure = by_transfer_confidence(rival.score, max((one.score for one in others), default=0.0))
    words = (
        advice.retuning(rival.effect, None)
        if rival.own
        else advice.adding(rival.effect, values, baseline.log.record.dt)
    )
    words += (
        f"; fitted to the rest it removes {max(rival.score, 0.0):.0%} of the error of left-out sessions and "
        f"regimes, and {model.normal.chi2:.3g} of the noise remain: the hull's own error may pass for it. A "
        "recording from before the change (`--before`) parts the two"
    )
    near = [one.effect for one in others if one.score > 0.7 * rival.score and one.score >= NAMED]
    if near:
        words += f"; nearly as well: {', '.join(near)}"
    verdict = ("retune" if rival.own else "missing") if sure >= SURE else "suspect"
    if verdict == "suspect":
        words = advice.suspecting(rival.effect, words)
    return Finding(
        verdict,  # type: ignore[arg-type]
        rival.effect,
        (rival.effect,),
        share,
        low,
        high,
        sure,
        parameters=values,
        standard_errors=dict(table["standard_error"]),
        advice=words,
    )
