"""Which physical effect is missing in a vehicle file, and how sure is that?

The file's own effects are first fitted anew, so that a drag coefficient a quarter wrong is not taken for
something missing.  Then `diagnosis.search` holds the whole catalogue against what is left.  What it names
comes with its share of the error, the effects that explain it as well (`diagnosis.naming`), and what to do
next; so does what the file has with other values, what the recording could not have shown, and what no effect
explains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import polars as pl
from scipy.stats import f as fisher

from hydro.core.columns import Array, Progress
from hydro.core.diagnosis import advice, naming, slow, unexplained
from hydro.core.diagnosis.coloured import coloured
from hydro.core.diagnosis.findings import Diagnosis, Finding
from hydro.core.diagnosis.identifiability import undetermined
from hydro.core.diagnosis.left_out import Fitted, scores
from hydro.core.diagnosis.log_faults import sound
from hydro.core.diagnosis.manoeuvres import best, plain, showing
from hydro.core.diagnosis.search import (
    ALPHA,
    MATERIAL,
    Found,
    Model,
    Round,
    Search,
    fitted,
    own_effects,
)
from hydro.core.diagnosis.sensor_tests import kinematic_tests
from hydro.core.errors import DataError
from hydro.core.identification import multiple_shooting
from hydro.core.identification.candidate import candidate
from hydro.core.identification.fit import UNDETERMINED, Fit, OutputError, judged
from hydro.core.identification.levenberg_marquardt import ITERATIONS, PRIOR
from hydro.core.identification.normal_equations import block_length, covariance
from hydro.core.identification.parameters import free
from hydro.core.identification.prior import in_file, steadied
from hydro.core.identification.suspects import CURVED, choice
from hydro.core.recording.arrays import Recording, drawn, recording
from hydro.core.vehicle.description import Vehicle

SECONDS = (multiple_shooting.SECONDS, 0.5 * multiple_shooting.SECONDS, 0.25 * multiple_shooting.SECONDS)
"""Lengths of a shot that are tried, for vehicles that the model makes unstable [s]."""
KEPT = 0.95
"""Part of the shots that must keep within bounds."""
LEAST_SHOTS, MOST_SHOTS = 16, 600
CONFIRMED = 0.5
"""Part of what an effect explains that it must explain of sessions left out, or else a warning is due."""
STRUCTURED = 0.05
"""Share of the noise that error which no effect explains must reach to be told."""
LEFT = 0.05
"""Share of the error beyond the noise which it must reach besides."""
OVERLAP = 0.7
"""Part of what findings explain together below which the sum of what each adds tells that they overlap."""
IMITATED = 0.5
"""What no effect explains, in units of what a finding explains, from which it casts doubt on the finding."""


def diagnose(vehicle: Vehicle, raw: pl.DataFrame, *, report: Progress | None = None) -> Diagnosis:
    """Find what is missing in a vehicle file.

    Args:
        vehicle: The model.
        raw: Raw table of the measured motion and commands.
        report: Called with a few words and the share of the work done.

    Returns:
        Findings, the most telling first.  Shares are of the error beyond the noise that is left once the
        file's own effects are fitted anew; of `retune` of those effects, of the error of the file as given.

    Raises:
        DataError: The recording or the vehicle is at fault, or the recording is too short.
    """
    told = report or (lambda words, share: None)
    told("shots", 0.0)
    log = sound(vehicle, raw)
    raw, record = log.raw, recording(log.raw, vehicle)
    base, reach, problem = own_effects(vehicle), record.eta[:, :3], aimed(vehicle, record)
    shots = problem.shots
    told("the file's own effects", 0.05)
    first, sensors = fitted(vehicle, base, problem, reach, ITERATIONS), kinematic_tests(record)
    sigma = coloured(shots.sigma, first.normal, record, sensors)
    if sigma is not shots.sigma:
        problem = problem.weighed(sigma)
        first = fitted(first.vehicle, base, problem, reach, ITERATIONS)
    given = fitted(vehicle, [], problem, reach, 0)
    search = Search(first, base, reach, sensors, problem)
    model, found, last = search.grow(told)
    told("looking back", 0.8)
    model, found, without = search.reconsider(model, found)
    wanted = [*base, *(one.effect for one in found)]
    model = fitted(model.vehicle, wanted, model.problem, reach, ITERATIONS, share=0.0)
    model = replace(model, values=steadied(model.unknown, model.values, model.normal, vehicle))
    told("verdicts", 0.9)
    result = _judged(model) if wanted else None
    white = sigma is shots.sigma and not drawn(record)
    left = _left(search, model, last, record, raw, white)
    named = [_named(one, search, model, without[one.effect], result, vehicle, shots) for one in found]
    together = float(np.clip((first.normal.cost - model.normal.cost) / max(first.excess, 1e-9), 0.0, 1.0))
    findings = [doubted(one, left) for one in shared(named, together)] + left
    findings.sort(key=lambda one: -one.share)
    if not findings:
        findings.append(_nothing(first, last))
    findings += sorted(_retuned(vehicle, base, given, model, result), key=lambda one: -one.share)
    told_of = {name for one in findings for name in one.members}
    findings += (one for one in _unseen(last, model, shots) if one.effect not in told_of)
    told("done", 1.0)
    chi2 = (given.normal.chi2, first.normal.chi2, model.normal.chi2)
    return Diagnosis((*log.faults, *findings), result.vehicle if result else vehicle, chi2)


def aimed(vehicle: Vehicle, record: Recording) -> OutputError:
    """Shots as long as the vehicle's predictions keep within bounds, those that do not left out.

    Raises:
        DataError: The recording is too short, or no prediction keeps within bounds.
    """
    for seconds in SECONDS:
        shots = multiple_shooting.aim(record, seconds=seconds, most=MOST_SHOTS)
        if len(shots.starts) < LEAST_SHOTS:
            least, gaps = LEAST_SHOTS * seconds, int(record.after_gap.sum())
            remedy = f"record at least {least:g} s, better some minutes"
            if record.rows * record.dt > least and gaps:
                remedy = f"{gaps} gaps cut the log to pieces: `hydro import` bridges those of a few samples"
            raise DataError(
                f"{len(shots.starts) * seconds:g} s without a gap are too short for a diagnosis; {remedy}"
            )
        problem = OutputError.of(shots, vehicle)
        kept = multiple_shooting.bounded(
            multiple_shooting.load(candidate(vehicle), problem.shots), problem.shots
        )
        if kept.mean() >= KEPT:
            return OutputError(multiple_shooting.some(problem.shots, kept))
    raise DataError(
        f"the vehicle's predicted motion grows beyond all bounds within {SECONDS[-1]:g} s; check its "
        "damping, or begin with `hydro fit --effect linear_damping`"
    )


def _named(
    one: Found,
    search: Search,
    model: Model,
    without: Model,
    result: Fit | None,
    vehicle: Vehicle,
    shots: multiple_shooting.Shots,
) -> Finding:
    """The finding of one effect that joined the model."""
    first = search.first
    pieces = max(block_length(model.normal.score), 1)
    share, low, high = naming.share(without.costs - model.costs, first.costs - first.normal.freedom, pieces)
    tied = naming.wins(one.rivals, one.effect)
    parameters, errors = _tables(result, one.effect)
    several = len(tied) > 1
    if several:
        flight = best([one.rivals[name].vehicle for name in tied], shots.sigma, start=_where(shots))
        words = advice.separating(list(tied), flight)
    else:
        words = advice.adding(one.effect, parameters, shots.record.dt)
    known = bool(vehicle.effects(one.effect))
    if known and not several:
        words = advice.retuning(one.effect)
    words += _confirmed(one.effect, without, model, shots)
    return Finding(
        "cannot_tell_apart" if several else "retune" if known else "missing",
        one.effect,
        tuple(tied),
        share,
        low,
        high,
        tied[one.effect],
        one.p_value,
        parameters,
        errors,
        advice=words,
    )


def shared(findings: Sequence[Finding], together: float) -> list[Finding]:
    """The findings with what they explain together parted among them, where one can stand in for another.

    Then each adds little to the others, and all they add is far less than what they explain.

    Args:
        findings: Each with what it adds to the others as its share.
        together: What all of them explain.
    """
    added = sum(one.share for one in findings)
    if added >= OVERLAP * together or added <= 0.0:
        return list(findings)
    names, parted = " and ".join(one.effect for one in findings), []
    for one in findings:
        low, share, high = (value * together / added for value in (one.low, one.share, one.high))
        words = (
            f"; {names} explain {together:.0%} together, and each can stand for most of it: this one adds "
            f"{one.share:.0%} to the others"
        )
        parted.append(replace(one, share=share, low=low, high=min(high, 1.0), advice=one.advice + words))
    return parted


def doubted(finding: Finding, left: Sequence[Finding]) -> Finding:
    """The finding, with a warning and less confidence where what no effect explains is of its own size.

    Where commands answer to a disturbance, as a pilot's or a controller's do to waves, the recording holds
    the disturbance and the answer together, and inertia or damping seem to be other than they are.
    """
    rest = sum(one.share for one in left)
    if rest < IMITATED * finding.share:
        return finding
    words = (
        f"; {rest:.0%} of the error no effect explains, and this one may stand for part of it: where the "
        "commands answer to waves or the like, fly without feedback before you trust its values"
    )
    sure = finding.confidence * finding.share / (finding.share + rest)
    return replace(finding, confidence=sure, advice=finding.advice + words)


def _confirmed(effect: str, without: Model, model: Model, shots: multiple_shooting.Shots) -> str:
    """A warning where sessions that an effect was not fitted to do not bear it out; empty where they do.

    Only the effect's own entries are fitted anew: of what the file has beside it one session may tell alone.
    """
    session = shots.record.session[shots.segment]
    own = [i for i, entry in enumerate(model.unknown.entries) if entry.effect == effect]
    before = Fitted(without.normal.of([]), np.zeros(0))
    after = Fitted(model.normal.of(own), np.zeros(len(own)))
    elsewhere = scores(before, {effect: after}, session)[effect].share
    here = (without.normal.cost - model.normal.cost) / max(without.excess, 1e-9)
    if elsewhere >= CONFIRMED * min(here, 1.0):
        return ""
    return (
        f"; one session alone tells of it: left out, it is predicted {elsewhere:.0%} better, not {here:.0%}"
    )


def _judged(model: Model) -> Fit:
    """The model's effects with standard errors, and as a passive hull can have them."""
    return judged(model.unknown, model.values, model.normal, model.normal.chi2, "output")


def _tables(result: Fit | None, effect: str) -> tuple[dict[str, object], dict[str, object]]:
    """Values and standard errors of one fitted effect."""
    for table in result.tables() if result else ():
        if table["name"] == effect:
            values = {k: v for k, v in table.items() if k not in ("name", "standard_error") and v is not None}
            return values, dict(table["standard_error"])
    raise KeyError(effect)


def _left(
    search: Search, model: Model, last: Round, record: Recording, raw: pl.DataFrame, white: bool
) -> list[Finding]:
    """That structured error remains which no effect explains.

    Structured is what some effect answers to by more than chance, or, where the sensors' noise is white,
    what a steady force in each shot would.
    """
    first = search.first
    if model.excess < max(LEFT * first.excess, STRUCTURED * model.normal.residuals):
        return []
    if not last.significant and not (white and _steadily(model) >= STRUCTURED):
        return []
    gain = model.costs - model.normal.freedom
    share, low, high = naming.share(
        gain, first.costs - first.normal.freedom, max(block_length(model.normal.score), 1)
    )
    where = unexplained.words(model.vehicle, record, raw)
    return [
        Finding(
            "none_of_the_known",
            share=share,
            low=low,
            high=high,
            p_value=last.p_value if last.significant else np.nan,
            advice=f"structured error remains that no effect of the catalogue explains: {where}",
        )
    ]


def _steadily(model: Model) -> float:
    """What steady forces explain of what is left."""
    pulls = list(slow.pulled(model.vehicle))
    return slow.share(model.problem.linearise(model.vehicle, pulls, [1.0] * slow.WRENCH))


def _nothing(first: Model, last: Round) -> Finding:
    """That the file, its own effects fitted anew, explains the recording."""
    return Finding(
        "nothing_missing",
        p_value=last.p_value,
        advice=f"mean squared residual {first.normal.chi2:.3g} of the noise (1: nothing but noise)",
    )


def _retuned(
    vehicle: Vehicle, base: Sequence[str], given: Model, model: Model, result: Fit | None
) -> Iterator[Finding]:
    """Effects of the file whose values as given would cost much, and that the recording tells from these.

    Much is measured by the squared error of the model found: so what a share of a poor file's error would
    pass over does not spoil what is added to it.
    """
    spread = covariance(model.normal, np.full(len(model.values), PRIOR**-2))
    matrix = model.normal.matrix.sum(axis=0)
    blocks = len(model.normal.gram) // block_length(model.normal.score)
    for name in base:
        entries = [i for i, entry in enumerate(model.unknown.entries) if entry.effect == name]
        before = in_file(vehicle, [model.unknown.entries[i] for i in entries])
        change = (model.values[entries] - before) / model.unknown.scales[entries]
        cost = float(change @ matrix[np.ix_(entries, entries)] @ change)
        if cost < MATERIAL * model.normal.cost:
            continue
        wald = float(change @ np.linalg.solve(spread[np.ix_(entries, entries)], change)) / len(entries)
        p = float(fisher.sf(wald, len(entries), max(blocks - len(entries), 1)))
        if p <= ALPHA:
            values, errors = _tables(result, name)
            share = float(np.clip(cost / max(given.excess, 1e-9), 0.0, 1.0))
            yield Finding(
                "retune",
                name,
                (name,),
                share,
                p_value=p,
                parameters=values,
                standard_errors=errors,
                advice=advice.retuning(name),
            )


def _unseen(last: Round, model: Model, shots: multiple_shooting.Shots) -> Iterator[Finding]:
    """Effects, or entries of them, that the recording could not have shown."""
    hidden: dict[str, tuple[str, ...]] = {}
    for name, (_, columns) in last.ranked.items():
        spread = last.evidence.covariance(last.own, columns, model.normal.chi2)
        if (np.diag(spread) > UNDETERMINED**2).all():
            hidden[name] = ()
        elif name not in CURVED:
            entries = free(model.vehicle, [choice(model.vehicle, name)]).entries
            hidden |= undetermined(entries, spread)
    if not hidden:
        return
    vehicles = {name: plain(model.vehicle, name) for name in hidden}
    flights = showing(model.vehicle, vehicles, shots.sigma, start=_where(shots))
    for name, open_ in hidden.items():
        words = advice.exciting(name, open_, flights.get(name))
        yield Finding("not_excited", name, (name,), excited=False, advice=words)


def _where(shots: multiple_shooting.Shots) -> Array:
    """Where the next manoeuvre would begin: amid the recording, level."""
    middle: Array = np.median(shots.record.eta, axis=0) * [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    return middle
