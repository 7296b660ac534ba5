"""Advice for each finding of a diagnosis: the next step for the user, in one or two sentences."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from hydro.core.effects import CATALOGUE
from hydro.core.experiment.library import FLIGHT_LENGTH
from hydro.core.experiment.manoeuvres import Flight
from hydro.core.identification.prior import ABSURD, Change

ADD = "add it with `hydro add`"
STATED_CHANGE = 1.0
"""Change of a value above which the advice states both numbers, in standard deviations of the prior."""
CLEAR = 10.0
"""Predicted difference of two models, in units of the sensor noise, at which one manoeuvre separates them.

A smaller difference needs a longer run; the advice then gives its duration.
"""


def separating(members: Sequence[str], flight: Flight | None = None) -> str:
    """Return advice on the motion that separates effects which explain a recording equally well.

    Args:
        members: Names of the tied effects.
        flight: Best manoeuvre for the tied effects from `manoeuvres.best`; None for general advice by effect.
    """
    if flight is not None and flight.difference > 0.0:
        return f"to separate them: {_predicted(flight)}"
    parted = Counter(motion for name in set(members) for motion in CATALOGUE[name].advice.parted_by)
    count, words = max(((count, motion) for motion, count in parted.items()), default=(0, ""))
    if count >= 2:
        return f"to separate them: {words}"
    needs = "; ".join(f"for {name}, {CATALOGUE[name].excitation}" for name in members)
    return f"to separate them: {needs}"


def _predicted(flight: Flight) -> str:
    """Return a manoeuvre in words, with the duration and the predicted difference between the models."""
    words, seen = flight.manoeuvre.words, flight.difference
    expected = f"predicted difference in {FLIGHT_LENGTH:g} s: {float(f'{seen:.2g}'):g} times the sensor noise"
    if seen >= CLEAR:
        return f"{words} ({expected})"
    minutes = FLIGHT_LENGTH / 60.0 * (CLEAR / seen) ** 2
    return (
        f"{words}, for {minutes:.0f} min or more ({expected})"
        if minutes < 120.0
        else f"{words} ({expected}, too little)"
    )


def in_waves(sea: Mapping[str, Any], speed: float, alone: bool) -> str:
    """Return the finding of waves in one sentence: period, direction, water velocity, and what to do.

    Args:
        sea: Parameters of the effect `ocean_waves`; `period` [s] and `direction` [rad] are used.
        speed: Root mean square velocity of the water at the vehicle that the waves cause [m/s].
        alone: Whether the diagnosis has no other finding.
    """
    toward = math.degrees(float(sea["direction"])) % 360.0
    others = (
        "nothing else was found, but the waves may hide small effects"
        if alone
        else "all other findings account for them"
    )
    return (
        f"waves of {float(sea['period']):.1f} s toward {toward:.0f} degrees move the water at the vehicle by "
        f"{speed:.2g} m/s (root mean square), which no file can predict; {others}; {ADD}: fits and "
        "comparisons then account for them, and `hydro simulate --sea` draws them"
    )


def adding(effect: str, parameters: Mapping[str, Any], dt: float) -> str:
    """Return the advice to add a missing effect, or to correct a likelier cause of its fitted values.

    Args:
        effect: Name of the missing effect.
        parameters: Fitted parameters of the effect, by name.
        dt: Sample time of the recording [s].
    """
    saying = CATALOGUE[effect].advice.saying
    words = saying(parameters, dt) if saying is not None else None
    if words is not None:
        return words
    return f"{ADD}; {CATALOGUE[effect].definition}"


def advises_adding(words: str) -> bool:
    """Return whether the advice of a finding is to add the effect, not to correct the log first.

    Args:
        words: Advice, such as that of `adding` or `retuning`.
    """
    return "hydro add" in words


def suspecting(effect: str, words: str) -> str:
    """Return the advice for a missing effect whose name is unconfirmed: `words` with a warning.

    Advice that is not to add the effect, such as to correct the log, remains as it is.

    Args:
        effect: Name of the effect.
        words: Advice for the same effect if it were confirmed, from `adding`.
    """
    if not advises_adding(words):
        return words
    by_name = f"add it by name only if you can confirm it on the vehicle (`hydro add --effect {effect}`)"
    return words.replace(ADD, by_name) if ADD in words else f"{words}; {by_name}"


def retuning(effect: str, change: Change | None = None) -> str:
    """Return the advice to change the values of an effect that the vehicle file already has.

    Args:
        effect: Name of the effect.
        change: Component with the largest change relative to its prior; None leaves the numbers out.
    """
    words = f"{effect} needs new values"
    if change is None or change.deviations <= STATED_CHANGE:
        return f"{words}; `hydro add` replaces them"
    told = (
        f"{words}: {change.entry.name} changes from {change.given:.3g} to {change.value:.3g}, by "
        f"{change.deviations:.2g} times the uncertainty of the file's value"
    )
    if change.deviations <= ABSURD:
        return f"{told}; `hydro add` replaces them"
    return (
        f"{told}. That is implausible: the value may absorb an effect missing in the file; "
        "do not add it unless you know that the file's value is wrong"
    )


def having_changed(effect: str, change: Change) -> str:
    """Return the advice for an effect of the file whose values have changed since an earlier recording.

    Args:
        effect: Name of the effect.
        change: Component with the largest change relative to its prior.
    """
    return (
        f"{effect} has changed: {change.entry.name} from {change.given:.3g} to {change.value:.3g}; "
        "`hydro add` replaces its values"
    )


def contradicting(change: Change, share: float) -> str:
    """Return the advice for a value that the file marks as known but the recording contradicts.

    Args:
        change: Greatest change of a component that would result if the known values were fitted.
        share: Share of the prediction error beyond the noise that new values would remove, 0 to 1.
    """
    return (
        f"held as known and not re-estimated, but the recording contradicts it: {change.entry.name} would "
        f"change from {change.given:.3g} to {change.value:.3g}, and that would explain {share:.0%} of the "
        "error; another finding may absorb this error"
    )


def being_alias(effect: str, others: Sequence[str]) -> str:
    """Return the advice for an effect whose forces are those of a sum of other effects in every recording.

    Args:
        effect: Name of the effect.
        others: Names of the other effects.
    """
    return (
        f"{effect} equals {' + '.join(others)}, in the file or found, in every recording; "
        "choose from what you know of the vehicle"
    )


def exciting(effect: str, entries: Sequence[str], flight: Flight | None = None) -> str:
    """Return advice on the motion to record for an effect that the present recording does not show.

    Args:
        effect: Name of the effect.
        entries: Names of the undetermined components; empty for the whole effect.
        flight: Best manoeuvre for the effect from `manoeuvres.showing`; None for the general advice.
    """
    hidden = ", ".join(entries) or CATALOGUE[effect].name.replace("_", " ")
    shows = flight is not None and flight.difference >= CLEAR
    motion = _predicted(flight) if flight is not None and shows else CATALOGUE[effect].excitation
    return f"this recording does not show {hidden}; record {motion}"
