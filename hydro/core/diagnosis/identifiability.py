"""What a recording does not determine of an effect, in words; and effects that no recording can tell apart.

Thrusters that never ran, axes that never moved: of such entries the data say nothing, though they may say
much of the effect's others.  And thrusters that always ran in step have gains of which only the sum is known.

A payload without mass is a net buoyancy and a shifted centre of buoyancy: an exact alias in any recording.
That its forces say, at many states drawn at random, of every attitude, velocity and command.

What a diagnosis leaves open, effects that explain a recording about as well and what it does not show, is
the question that the next flight is to answer.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from hydro.core.columns import DOF, Array
from hydro.core.diagnosis.baseline import Baseline, Found, Outcome
from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.model import Model
from hydro.core.effects import CATALOGUE, inertia_matrix
from hydro.core.errors import DataError
from hydro.core.experiment import advice
from hydro.core.experiment.discrimination import Rival
from hydro.core.experiment.flight import Question
from hydro.core.experiment.manoeuvres import plain, showing
from hydro.core.identification.levenberg_marquardt import moved
from hydro.core.identification.outcome import UNDETERMINED
from hydro.core.identification.suspects import choice, is_curved, suspects
from hydro.core.prediction.candidate import accelerations, candidate
from hydro.core.prediction.parameters import Entry, free
from hydro.core.recording.arrays import Recording
from hydro.core.simulation.excitation import LOG_RATE
from hydro.core.vehicle.description import Vehicle

EXACT = 1e-6
"""Part of a column that may be left over of it, for rounding alone."""
STATES = 200
MIDDLE = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
REACH = np.array([10.0, 10.0, 4.0, 0.6, 1.2, np.pi])  # m and rad, about it
SPEED = np.array([1.5, 1.5, 1.5, 1.0, 1.0, 1.0])  # m/s and rad/s
VECTORS: Mapping[str, tuple[str, str, str]] = {
    "alpha": ("roll", "pitch", "yaw"),
    "anchor": ("anchor north", "anchor east", "anchor down"),
    "attachment": ("attachment forward", "attachment to starboard", "attachment down"),
    "drag": ("surge", "sway", "heave"),
    "position": ("position forward", "position to starboard", "position down"),
}
"""Names of a vector's entries, where they are not the body's axes."""
BODY = ("forward", "to starboard", "down")
CLOSEST = 3
"""Rivals of a suspect, itself among them."""


def undetermined(entries: Sequence[Entry], covariance: Array) -> dict[str, tuple[str, ...]]:
    """What the recording leaves open of effects that it says something of.

    Args:
        entries: The free entries.
        covariance: Of their estimates, (P, P), each in units of its scale: `Evidence.covariance`, or
            `Fit.covariance` over the product of scales.

    Returns:
        Words by effect, as ("thrusters 5-8",) or ("sway", "yaw"); no effect that is determined wholly, or of
        which nothing is.
    """
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    found: dict[str, tuple[str, ...]] = {}
    for effect in dict.fromkeys(entry.effect for entry in entries):
        places = [i for i, entry in enumerate(entries) if entry.effect == effect]
        open_ = [i for i in places if errors[i] > UNDETERMINED]
        words = tuple(_words([entries[i] for i in open_]))
        together = len(open_) > 1 and _together(covariance[np.ix_(open_, open_)]) <= UNDETERMINED
        if together:
            found[effect] = (f"{', '.join(words)} (one from another)",)
        elif 0 < len(open_) < len(places):
            found[effect] = words
    return found


def _together(covariance: Array) -> float:
    """Standard error of the mean of some entries."""
    return float(np.sqrt(max(covariance.mean(), 0.0)))


def _words(entries: Sequence[Entry]) -> list[str]:
    """Entries of one effect in words, thrusters next to each other as a range."""
    thrusters = [entry.index[0] + 1 for entry in entries if _per_thruster(entry)]
    words = [_range(thrusters)] if thrusters else []
    return words + [_word(entry) for entry in entries if not _per_thruster(entry)]


def _per_thruster(entry: Entry) -> bool:
    shape = next(p.shape for p in CATALOGUE[entry.effect].parameters if p.name == entry.parameter)
    return shape == ("thrusters",)


def _range(numbers: Sequence[int]) -> str:
    """`thruster 3`, `thrusters 1, 5-8`."""
    cuts = [0, *(i + 1 for i, (a, b) in enumerate(pairwise(numbers)) if b != a + 1), len(numbers)]
    runs = [(numbers[a], numbers[b - 1]) for a, b in pairwise(cuts)]
    listed = ", ".join(f"{a}-{b}" if b > a else f"{a}" for a, b in runs)
    return f"thrusters {listed}" if len(numbers) > 1 else f"thruster {listed}"


def _word(entry: Entry) -> str:
    """One entry: an axis, two axes of a matrix, or the parameter's own name."""
    shape = next(p.shape for p in CATALOGUE[entry.effect].parameters if p.name == entry.parameter)
    if shape == (6, 6):
        row, column = (DOF[i] for i in entry.index)
        return row if row == column else f"{row} from {column}"
    if shape and shape[-1] == 6:
        axis = DOF[entry.index[-1]]
        return axis if len(shape) == 1 else f"{axis} (rate {entry.index[0] + 1})"
    if shape == (3,):
        return VECTORS.get(entry.parameter, BODY)[entry.index[0]]
    return entry.parameter if not entry.index else f"{entry.parameter} {entry.index[0] + 1}"


def aliases(model: Model, known: Sequence[str], reach: Array | None = None) -> dict[str, tuple[str, ...]]:
    """Effects whose forces the model's own effects have already.

    Inertia that an effect has besides does not count: it shows in accelerations, and is another matter.

    Args:
        model: The vehicle and its free entries.
        known: Names of the effects that are in it, which are not asked about.
        reach: Positions and times of the recording, (N, 4), among which an anchor is looked for.

    Returns:
        The effects of the model that each alias is made of, by the alias' name.
    """
    if not model.unknown.entries:
        return {}
    states = _states(len(model.vehicle.thruster))
    still, inertia = _forces(model.vehicle, states), inertia_matrix(model.vehicle)

    def unit(vehicle: Vehicle) -> Array:
        column = _forces(vehicle, states) - still
        size = float(np.linalg.norm(column))
        return column / size if size > EXACT * EXACT * float(np.linalg.norm(still)) else 0.0 * column

    own = np.stack([unit(vehicle) for vehicle in moved(model.unknown, model.values)[0]], axis=1)
    found: dict[str, tuple[str, ...]] = {}
    for suspect in suspects(model.vehicle, without=known, reach=reach):
        forces = [one for one in suspect.changed if np.array_equal(inertia_matrix(one), inertia)]
        columns = np.stack([unit(one) for one in forces], axis=1) if forces else np.zeros((len(own), 1))
        if not columns.any(axis=0).all():
            continue
        amounts = np.linalg.lstsq(own, columns, rcond=None)[0]
        if np.linalg.norm(columns - own @ amounts, axis=0).max() <= EXACT:
            used = np.abs(amounts).max(axis=1) > EXACT
            pairs = zip(model.unknown.entries, used, strict=True)
            found[suspect.effect] = tuple(dict.fromkeys(entry.effect for entry, one in pairs if one))
    return found


def _forces(vehicle: Vehicle, states: Recording) -> Array:
    """What a vehicle's forces make of some states, (6 N,): its accelerations."""
    return accelerations(candidate(vehicle), states, states.eta, states.nu).ravel()


def _states(thrusters: int) -> Recording:
    """States that no two effects share by chance: each row on its own."""
    rng = np.random.default_rng(0)
    return Recording(
        t=np.linspace(0.0, 0.02 * (STATES - 1), STATES),
        eta=MIDDLE + rng.uniform(-REACH, REACH, (STATES, 6)),
        nu=rng.uniform(-SPEED, SPEED, (STATES, 6)),
        commands=rng.uniform(-1.0, 1.0, (STATES, thrusters)),
        segments=np.array([[0, STATES]], np.int64),
        after_gap=np.zeros(1, bool),
        session=np.zeros(1, np.int64),
        dt=0.02,
    )


def left_open(baseline: Baseline, outcome: Outcome, findings: Sequence[Finding]) -> Question:
    """The rivals of every finding whose name is not sure, and what the recording does not show."""
    model, log = outcome.model, baseline.log
    ties = []
    for found in outcome.found:
        verdicts = {one.verdict for one in findings if one.effect == found.effect}
        if verdicts & {"cannot_tell_apart", "suspect"}:
            members = next(one.members for one in findings if one.effect == found.effect)
            ties.append(_rivals(found, members, outcome))
    hidden = tuple(one.effect for one in findings if one.verdict == "not_excited")
    widened = np.sqrt(max(model.normal.chi2, 1.0) * log.record.dt * LOG_RATE)
    sigma = baseline.problem.shots.sigma * widened
    return Question(tuple(ties), _rival("", model), hidden, sigma, log.middle, log.track)


def _rivals(found: Found, members: Sequence[str], outcome: Outcome) -> tuple[Rival, ...]:
    """The effects of a tie, or of a suspect the nearest contenders; without any, the model without it."""
    order = sorted(found.rivals, key=lambda name: float(found.rivals[name].penalised.sum()))
    names = [name for name in members if name in found.rivals]
    if len(names) < 2:
        names += [name for name in order if name not in names][: CLOSEST - len(names)]
    if len(names) < 2:
        rest = _rival(f"no {found.effect}", outcome.without[found.effect])
        return (_rival(found.effect, outcome.model), rest)
    return tuple(_rival(name, found.rivals[name]) for name in names)


def _rival(name: str, model: Model) -> Rival:
    return Rival.of(name, model.unknown, model.values, model.normal)


def unseen(baseline: Baseline, outcome: Outcome) -> Iterator[Finding]:
    """Effects, or entries of them, that no recording or not this one could have shown."""
    log, model, last = baseline.log, outcome.model, outcome.last
    hidden: dict[str, tuple[str, ...]] = {}
    known = [*baseline.effects, *outcome.effects]
    same = aliases(model, known, log.track)
    for name, others in same.items():
        yield Finding("not_separable", name, (name, *others), advice=advice.being_alias(name, others))
    for name, (_, columns) in last.ranked.items():
        if name in same:
            continue
        spread = last.evidence.covariance(last.own, columns, model.normal.chi2)
        if (np.diag(spread) > UNDETERMINED**2).all():
            hidden[name] = ()
        elif not is_curved(name):
            entries = free(model.vehicle, [choice(model.vehicle, name)]).entries
            hidden |= undetermined(entries, spread)
    if not hidden:
        return
    vehicles = {name: plain(model.vehicle, name) for name in hidden}
    try:
        flights = showing(model.vehicle, vehicles, log.noise, start=log.middle)
    except DataError:  # no manoeuvre stays finite with such values: the general advice stands
        flights = {}
    for name, entries_open in hidden.items():
        words = advice.exciting(name, entries_open, flights.get(name))
        yield Finding("not_excited", name, (name,), excited=False, advice=words)
