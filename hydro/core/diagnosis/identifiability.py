"""Which entries of an effect a recording does not determine, in words.

Thrusters that never ran, axes that never moved: of such entries the data say nothing, though they may say
much of the effect's others.  And thrusters that always ran in step have gains of which only the sum is known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from hydro.core.columns import DOF, Array
from hydro.core.effects import CATALOGUE
from hydro.core.identification.fit import UNDETERMINED
from hydro.core.identification.parameters import Entry

VECTORS: Mapping[str, tuple[str, str, str]] = {
    "alpha": ("roll", "pitch", "yaw"),
    "anchor": ("anchor north", "anchor east", "anchor down"),
    "attachment": ("attachment forward", "attachment to starboard", "attachment down"),
}
"""Names of a vector's entries, where they are not the body's axes."""
BODY = ("forward", "to starboard", "down")


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
