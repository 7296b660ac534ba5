"""Sentences on the changes of a vehicle over its dives."""

from __future__ import annotations

from collections.abc import Sequence

from hydro.core.history.change_points import LEVEL
from hydro.core.history.changes import Change
from hydro.core.history.parameters import BUOYANCY, DRAG, THRUST, Parameter
from hydro.core.interval import NORMAL_95

PERFECT = {"rose": "risen", "grew": "grown", "fell": "fallen"}


def sentence(change: Change, parameter: Parameter, dives: Sequence[str]) -> str:
    """Return one change in a sentence: size with the 95 % interval, and the dives between which it happened.

    Args:
        change: The change.
        parameter: The parameter that changed.
        dives: Names of all dives, in order.
    """
    when = _when(change, dives)
    if parameter.kind == THRUST:
        verb = _verb(change, "rose", "fell")
        before, after = (f"{100.0 * level:.0f} %" for level in (change.before, change.after))
        return f"{parameter.label} {verb} from {before} to {after} (±{_half(100.0 * change.error)}) {when}."
    if parameter.kind == BUOYANCY:
        verb, size = _verb(change, "rose", "fell"), abs(change.size)
        return f"{parameter.label} {verb} by {size:.1f} N (±{_half(change.error, 1)}) {when}."
    verb = _verb(change, "grew", "fell")
    size, half = abs(100.0 * change.size / change.before), _half(100.0 * change.error / abs(change.before))
    fouling = ": fouling?" if change.kind == "trend" and change.size > 0.0 and parameter.kind == DRAG else "."
    return f"{parameter.label} {verb} by {size:.0f} % (±{half}) {when}{fouling}"


def headline(found: Sequence[str], dives: int, baseline: int) -> str:
    """Return the first line of a history's report: all changes, or that there are none.

    Args:
        found: One sentence for each change.
        dives: Number of dives with an estimate.
        baseline: Number of baseline dives.
    """
    if found:
        return " ".join(found)
    if dives <= baseline:
        return f"The baseline has {baseline} dives, and there is no later dive to compare with it yet."
    return f"No parameter has changed in {dives} dives (baseline: the first {baseline})."


def limits() -> str:
    """Return a sentence on the false alarms to expect in a history and on the level of its intervals."""
    return (
        f"Expected number of false alarms, over all parameters: at most one in {1.0 / LEVEL:.0f} unchanged "
        "dives. Intervals (±) are of 95 %."
    )


def _when(change: Change, dives: Sequence[str]) -> str:
    """Return the time of a change in words, by the numbers and names of the dives."""
    if change.kind == "trend":
        return f"since dive {change.date + 1} ({dives[change.date]})"
    first, last = dives[change.date - 1], dives[change.date]
    return f"between dive {change.date} and {change.date + 1} ({first} and {last})"


def _verb(change: Change, up: str, down: str) -> str:
    """Return the verb for a rise (`up`) or a fall (`down`), in the present perfect for a trend."""
    verb = up if change.size > 0.0 else down
    if change.kind == "shift":
        return verb
    return f"has {PERFECT[verb]}"


def _half(error: float, digits: int = 0) -> str:
    """Return half the width of the 95 % interval as text, at least one unit of the last digit."""
    return f"{max(NORMAL_95 * error, 10.0**-digits):.{digits}f}"
