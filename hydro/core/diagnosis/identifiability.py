"""Components of an effect that a recording does not determine, and effects that no recording can separate.

The data do not determine a thruster that never ran or an axis that never moved.  They may determine the
effect's other components.  If thrusters always ran together, only the sum of their gains is known.

A payload without mass equals a net buoyancy and a shifted centre of buoyancy in any recording.  Such exact
aliases are found by comparing forces at many random states, of every attitude, velocity and command.

Open questions of a diagnosis are effects that explain the recording equally well, and effects that it does
not show.  They are input to the planning of the next experiment.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from hydro.core.columns import DOF, Array
from hydro.core.diagnosis.baseline import Baseline, Found, Outcome
from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.settings import CLOSEST, DISTINCT
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
"""Largest residual of an exact alias, due to rounding, as a share of the alias's forces."""
STATES = 200
"""Number of random states at which forces are compared."""
MIDDLE = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
"""Middle of the random poses, NED [m, rad]."""
REACH = np.array([10.0, 10.0, 4.0, 0.6, 1.2, np.pi])
"""Half range of the random poses about MIDDLE [m, rad]."""
SPEED = np.array([1.5, 1.5, 1.5, 1.0, 1.0, 1.0])
"""Half range of the random velocities [m/s, rad/s]."""
VECTORS: Mapping[str, tuple[str, str, str]] = {
    "alpha": ("roll", "pitch", "yaw"),
    "anchor": ("anchor north", "anchor east", "anchor down"),
    "attachment": ("attachment forward", "attachment to starboard", "attachment down"),
    "drag": ("surge", "sway", "heave"),
    "position": ("position forward", "position to starboard", "position down"),
}
"""Names of a vector's components, where they are not the body's axes."""
BODY = ("forward", "to starboard", "down")
"""Names of a vector's components along the body axes."""


def undetermined(entries: Sequence[Entry], covariance: Array) -> dict[str, tuple[str, ...]]:
    """Return the components that the recording leaves undetermined, of effects that it determines in part.

    Args:
        entries: P free components.
        covariance: Covariance of their estimates, (P, P), each in units of its scale: `Evidence.covariance`,
            or `Fit.covariance` over the product of scales.

    Returns:
        Words by effect, as ("thrusters 5-8",) or ("sway", "yaw").  Effects that are determined wholly or not
        at all are left out.
    """
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    found: dict[str, tuple[str, ...]] = {}
    for effect in dict.fromkeys(entry.effect for entry in entries):
        places = [i for i, entry in enumerate(entries) if entry.effect == effect]
        open_ = [i for i in places if errors[i] > UNDETERMINED]
        words = tuple(_words([entries[i] for i in open_]))
        mean = covariance[np.ix_(open_, open_)].mean() if len(open_) > 1 else np.inf  # variance of the mean
        if mean <= UNDETERMINED**2:
            found[effect] = (f"{', '.join(words)} (one from another)",)
        elif 0 < len(open_) < len(places):
            found[effect] = words
    return found


def _words(entries: Sequence[Entry]) -> list[str]:
    """Return components of one effect in words, with consecutive thrusters as a range."""
    thrusters = [entry.index[0] + 1 for entry in entries if _per_thruster(entry)]
    words = [_range(thrusters)] if thrusters else []
    return words + [_word(entry) for entry in entries if not _per_thruster(entry)]


def _per_thruster(entry: Entry) -> bool:
    shape = next(p.shape for p in CATALOGUE[entry.effect].parameters if p.name == entry.parameter)
    return shape == ("thrusters",)


def _range(numbers: Sequence[int]) -> str:
    """Return thruster numbers in words: `thruster 3`, `thrusters 1, 5-8`."""
    cuts = [0, *(i + 1 for i, (a, b) in enumerate(pairwise(numbers)) if b != a + 1), len(numbers)]
    runs = [(numbers[a], numbers[b - 1]) for a, b in pairwise(cuts)]
    listed = ", ".join(f"{a}-{b}" if b > a else f"{a}" for a, b in runs)
    return f"thrusters {listed}" if len(numbers) > 1 else f"thruster {listed}"


def _word(entry: Entry) -> str:
    """Return one entry in words: an axis, two axes of a matrix, or the parameter's name."""
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
    """Return effects outside a model whose forces are linear combinations of those of its free components.

    No recording can separate such an effect from the model's.  Parameters that change inertia, such as a dry
    mass, are not compared, because inertia shows in accelerations.  An effect with only such parameters is no
    alias.

    Args:
        model: Vehicle and its free components.
        known: Names of effects that are not tested: those that the model has already.
        reach: Positions [m] and times [s] of the recording, (N, 4), near which the place of an effect
            in the world is tried, such as a tether's anchor; None tries places near the origin of NED.

    Returns:
        The effects of the model that make up each alias, by the name of the alias.
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
    """Return a vehicle's accelerations at N states in one vector, (6 N,)."""
    return accelerations(candidate(vehicle), states, states.eta, states.nu).ravel()


def _states(thrusters: int) -> Recording:
    """Return random states at which no two effects agree by chance; each row is independent of the others.

    Args:
        thrusters: Number of thrusters.
    """
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


def _without_unseen_inertia(outcome: Outcome) -> Model:
    """Return the model without inertia that was found by chance, such as a payload's mass of a gram.

    The recording determines such a value, to UNDETERMINED of its scale, and it is at most DISTINCT standard
    errors from zero.  It would hide an alias.
    """
    model, fit = outcome.model, outcome.fit
    if fit is None:
        return model
    values = model.values.copy()
    for effect in outcome.effects:
        without = inertia_matrix(model.vehicle.without(effect))
        for i in model.unknown.places(effect):
            error, massless = fit.standard_errors[i], values.copy()
            massless[i] = 0.0
            known = error <= UNDETERMINED * model.unknown.scales[i] and abs(values[i]) <= DISTINCT * error
            if known and np.array_equal(inertia_matrix(model.unknown.at(massless)), without):
                values = massless
    return replace(model, values=values)


def left_open(baseline: Baseline, outcome: Outcome, findings: Sequence[Finding]) -> Question:
    """Return the open questions of a diagnosis, for the planning of the next experiment.

    These are the rivals of every uncertain finding, and the effects that the recording does not show.
    """
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
    """Return the effects between which an experiment should decide.

    These are the members of a tie, or else the closest contenders, or else the effect and the model without
    it.
    """
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
    """Yield findings of effects that no recording can separate, or that this recording does not show.

    Of an effect that the recording shows in part, the finding names the components that it does not show.
    """
    log, model, last = baseline.log, outcome.model, outcome.last
    hidden: dict[str, tuple[str, ...]] = {}
    known = [*baseline.effects, *outcome.effects]
    same = aliases(_without_unseen_inertia(outcome), known, log.track)
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
    except DataError:  # no manoeuvre stays finite with such values: use the general advice
        flights = {}
    for name, entries_open in hidden.items():
        words = advice.exciting(name, entries_open, flights.get(name))
        yield Finding("not_excited", name, (name,), excited=False, advice=words)
