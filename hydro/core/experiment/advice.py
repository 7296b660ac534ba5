"""What to do about a finding, in a sentence or two."""

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
TOLD = 1.0
"""Standard deviations of what is known of a value from which the size of its change is told."""
CLEAR = 10.0
"""Standard deviations of the noise by which a manoeuvre must part two effects to be flown once."""


def separating(members: Sequence[str], flight: Flight | None = None) -> str:
    """The manoeuvre that tells the members of a tie set apart.

    Args:
        members: Names of the effects.
        flight: What `manoeuvres.best` predicts for them; without, what is known of such effects in general.
    """
    if flight is not None and flight.difference > 0.0:
        return f"to tell them apart: {_predicted(flight)}"
    parted = Counter(motion for name in set(members) for motion in CATALOGUE[name].advice.parted_by)
    count, words = max(((count, motion) for motion, count in parted.items()), default=(0, ""))
    if count >= 2:
        return f"to tell them apart: {words}"
    needs = "; ".join(f"for {name}, {CATALOGUE[name].excitation}" for name in members)
    return f"to tell them apart: {needs}"


def _predicted(flight: Flight) -> str:
    """What to fly for how long, and what it is expected to show."""
    words, seen = flight.manoeuvre.words, flight.difference
    expected = (
        f"predicted difference in {FLIGHT_LENGTH:g} s: {float(f'{seen:.2g}'):g} times the sensors' noise"
    )
    if seen >= CLEAR:
        return f"{words} ({expected})"
    minutes = FLIGHT_LENGTH / 60.0 * (CLEAR / seen) ** 2
    return (
        f"{words}, for {minutes:.0f} min or more ({expected})"
        if minutes < 120.0
        else f"{words} ({expected}, too little)"
    )


def in_waves(sea: Mapping[str, Any], speed: float, alone: bool) -> str:
    """What waves mean for a model and for what else is said.

    Args:
        sea: Parameters of the effect.
        speed: Root mean square of the water's velocity that they bring to the vehicle [m/s].
        alone: Whether nothing else is found.
    """
    toward = math.degrees(float(sea["direction"])) % 360.0
    beside = "nothing else is missing" if alone else "what else is said"
    return (
        f"waves of {float(sea['period']):.1f} s toward {toward:.0f} degrees move the water at the vehicle by "
        f"{speed:.2g} m/s (root mean square); no file predicts them, and {beside} beside what they hide; "
        f"{ADD}: fits then weigh and comparisons allow for them, and `hydro simulate --sea` draws them"
    )


def adding(effect: str, parameters: Mapping[str, Any], dt: float) -> str:
    """What adding a missing effect means, or what its record says that such values mean instead."""
    saying = CATALOGUE[effect].advice.saying
    words = saying(parameters, dt) if saying is not None else None
    if words is not None:
        return words
    return f"{ADD}; {CATALOGUE[effect].definition}"


def suspecting(effect: str, words: str) -> str:
    """The advice `words` for a missing effect, where the recording is not sure enough of its name."""
    by_name = f"add it by its name alone (`hydro add --effect {effect}`), if the vehicle bears it out"
    return words.replace(ADD, by_name) if ADD in words else f"{words}; {by_name}"


def retuning(effect: str, change: Change | None = None) -> str:
    """What to do with an effect of the file that has other values.

    Args:
        effect: Its name.
        change: The one of its entries that goes farthest from what is known of it.
    """
    words = f"the recording supports other values of {effect}"
    if change is None or change.deviations <= TOLD:
        return f"{words}; `hydro add` replaces them"
    told = (
        f"{words}: {change.entry.name} goes from {change.given:.3g} to {change.value:.3g}, "
        f"{change.deviations:.2g} standard deviations of what is known of it"
    )
    if change.deviations <= ABSURD:
        return f"{told}; `hydro add` replaces them"
    return (
        f"{told}. That is beyond belief: it may stand for something that the file lacks; "
        "do not add it unless you know that the file's value is wrong"
    )


def having_changed(effect: str, change: Change) -> str:
    """What to do with an effect of the file that has other values than it had.

    Args:
        effect: Its name.
        change: The one of its entries that has changed most for what is known of it.
    """
    return (
        f"{effect} has other values than before: {change.entry.name} goes from {change.given:.3g} to "
        f"{change.value:.3g}; `hydro add` replaces them"
    )


def contradicting(change: Change, share: float) -> str:
    """That a recording contradicts a value which is held as known.

    Args:
        change: The entry that it would take farthest.
        share: Part of the error beyond the noise that other values would explain.
    """
    return (
        f"held as known and not re-estimated, but the recording contradicts it: {change.entry.name} "
        f"{change.given:.3g} would have to be {change.value:.3g}, and that would explain {share:.0%} of the "
        "error; what is found beside it may stand for this"
    )


def being_alias(effect: str, others: Sequence[str]) -> str:
    """That an effect does what others do together."""
    return (
        f"{effect} is an alias of {' + '.join(others)}, in the file or found: no recording can tell; "
        "choose by what you know of the vehicle"
    )


def exciting(effect: str, entries: Sequence[str], flight: Flight | None = None) -> str:
    """Which motion would show an effect that the recording does not.

    Args:
        effect: Its name.
        entries: What of it is not determined, in words; all of it where nothing is said.
        flight: What `manoeuvres.showing` predicts for it at plain size.
    """
    what = ", ".join(entries) or "it"
    shows = flight is not None and flight.difference >= CLEAR
    motion = _predicted(flight) if flight is not None and shows else CATALOGUE[effect].excitation
    return f"this recording could not show {what}; fly {motion}"
