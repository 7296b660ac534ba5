"""Conditions in which a model fails: much of the unexplained error of an axis in little of the time.

A place is a condition, such as turning left, or a pair of conditions.  All conditions and all pairs are
tried. A place with share e of an axis' error and share t of the time has the quality (e - t) / sqrt(t).  This
is proportional to the number of standard deviations above an even distribution of the error (Klösgen 1996).
The quality is computed in the even and in the odd blocks of the recording, and the smaller one counts.  The
best place is taken, the error in it is removed, and the search continues (sequential covering).  So the list
does not repeat one place in other words.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from hydro.core.columns import Array, Mask, Rows
from hydro.core.evaluation.regimes import PIECE_SECONDS, Condition, Family, conditions, phrase

LEAST_TIME = 0.01
"""Minimum duration of a place, as a share of the recording's."""
LEAST_SECONDS = 4.0
"""Minimum duration of a place [s]."""
MATERIAL_SHARE = 0.02
"""Minimum share of all unexplained error that a place adds to be listed."""
STANDS_OUT = 1.5
"""Minimum ratio of the error in a place to that of an even distribution over time."""
NEW = 0.5
"""Minimum share of a place's error that is not in an earlier place."""
SIMPLER = 1.2
"""Minimum ratio of a pair's quality to that of each of its conditions alone."""
MOST_SESSIONS = 100
"""Maximum number of conditions in a family that is searched: one of many sessions fails by chance."""
ELSEWHERE, THROUGHOUT = "in all other motion", "in all motion"
"""Words for the place of an axis' error outside its listed places, and without any listed place."""
MOST_PLACES = 12
"""Maximum number of listed places."""


@dataclass(frozen=True)
class Place:
    """Condition, such as "while turning left", in which a model has a large error on one axis.

    Attributes:
        words: Description in words.
        axis: Number of the axis.
        met: Mask of P pieces of time in which the condition is met, (P,).
        share: Fraction of all unexplained error that lies in this place and in no place listed earlier.
    """

    words: str
    axis: int
    met: Mask
    share: float


def rank(unexplained: Array, rows: Array, block: Rows, families: Sequence[Family]) -> list[Place]:
    """Rank the conditions in which a model fails, the largest share of the unexplained error first.

    The unexplained error is the squared error above what noise alone causes.

    Args:
        unexplained: Share of all unexplained error in each of P pieces of time and on each of A axes, (P, A).
            Noise may make a share negative; the sum is at most 1.
        rows: Rows of the recording in each piece, (P,).
        block: Block of each piece, (P,); odd blocks must confirm even blocks.
        families: Families of conditions that are searched.

    Returns:
        A new list of places whose shares do not overlap.  Then, for each axis on which much error remains, a
        place that stands for all other times.  The shares sum to 1 at most.
    """
    tried = [c for c in conditions(families) if len(c.family.words) <= MOST_SESSIONS]
    search = _Search(tried, rows, block % 2 == 0, unexplained)
    found: list[Place] = []
    left = unexplained.copy()
    while len(found) < MOST_PLACES and (best := search.best(left)) is not None:
        axis, several = best
        met = np.logical_and.reduce([c.met for c in several])
        share = float(left[met, axis].sum())
        found.append(Place(named(several), axis, met, share))
        left[met, axis] = 0.0
        search.forget(axis)
    rests = [_rest(axis, left[:, axis], found) for axis in range(unexplained.shape[1])]
    material = [rest for rest in rests if rest.share >= MATERIAL_SHARE]
    listed = [*sorted(found, key=_share, reverse=True), *sorted(material, key=_share, reverse=True)]
    # Noise makes some of the rest negative: the parts of an axis' error must not exceed the whole.
    parts = [sum(place.share for place in listed if place.axis == axis) for axis in range(len(rests))]
    scale = np.minimum(unexplained.sum(axis=0) / np.maximum(parts, 1e-300), 1.0)
    # Rounding must not make a whole larger than 1.
    return [replace(place, share=min(place.share * float(scale[place.axis]), 1.0)) for place in listed]


def _rest(axis: int, left: Array, found: Sequence[Place]) -> Place:
    """Return the place of all time on an axis that lies in none of the places found on the axis."""
    taken = [place.met for place in found if place.axis == axis]
    met = ~np.logical_or.reduce([np.zeros(len(left), bool), *taken])
    return Place(ELSEWHERE if taken else THROUGHOUT, axis, met, float(left.sum()))


def _share(place: Place) -> float:
    return place.share


def find(wanted: Set[str], families: Sequence[Family]) -> dict[str, Mask]:
    """Return, by the words of each condition, a mask of the P pieces of time in which it is met, (P,).

    Args:
        wanted: Words of the conditions, such as "while turning left".
        families: Families of conditions.  Words that match no condition, or pair of conditions, of these
            families are left out.
    """
    tried, found = list(conditions(families)), dict[str, Mask]()
    free = [c for c in tried if not c.family.alone]
    pairs = ((a, b) for a, b in itertools.combinations(free, 2) if a.family is not b.family)
    for several in itertools.chain(((c,) for c in tried), pairs):
        if len(found) == len(wanted):
            break
        if (words := named(several)) in wanted:
            found[words] = np.logical_and.reduce([c.met for c in several])
    return found


def named(several: Sequence[Condition]) -> str:
    """Return one phrase for conditions that hold together: "while turning left at speeds below 1 m/s"."""
    return phrase([(c.words, c.family.doing) for c in several])


class _Search:
    """Search over all conditions and pairs of conditions.

    The error of each axis is summed over the even and over the odd blocks of the recording, its two halves.
    """

    def __init__(self, tried: Sequence[Condition], rows: Array, half: Mask, unexplained: Array) -> None:
        self.tried = tried
        self.met = np.array([c.met for c in tried], np.float32).reshape(len(tried), len(rows)).T
        self.halves = [np.flatnonzero(half), np.flatnonzero(~half)]
        self.whole = self._halves(unexplained)
        time = rows / rows.sum()
        self.time, self.length = self._together(time), np.maximum(self._halves(time), 1e-12)
        self.own = [self._together(column) for column in unexplained.T]
        kinds = np.array([c.family.by for c in tried])
        free = np.array([not c.family.alone for c in tried], bool)
        least = max(LEAST_TIME, LEAST_SECONDS / (PIECE_SECONDS * len(rows)))
        pairs = (kinds[:, None] != kinds) & free & free[:, None]
        self.possible = (pairs | np.eye(len(tried), dtype=bool)) & (self.time.sum(axis=0) >= least)
        self.possible &= (self.time > 0.0).all(axis=0)
        self.known: dict[int, tuple[float, int, int] | None] = {}

    def _together(self, values: Array) -> Array:
        """Return sums of values (P,) over pieces that meet two of K conditions, by half, (2, K, K)."""
        weighted = self.met * values[:, None].astype(np.float32)
        return np.array([self.met[half].T @ weighted[half] for half in self.halves], np.float64)

    def _halves(self, values: Array) -> Array:
        """Return sums of values (P, ...) over each half of the recording, (2, ...); at least 0."""
        return np.array([np.maximum(values[half].sum(axis=0), 0.0) for half in self.halves])

    def forget(self, axis: int) -> None:
        """Discard the stored result of an axis, since the remaining error on the axis has changed."""
        self.known.pop(axis, None)

    def best(self, left: Array) -> tuple[int, tuple[Condition, ...]] | None:
        """Return axis and conditions of the place that stands out most; None if no place stands out.

        Args:
            left: Unexplained error of P pieces of time on A axes that no place contains yet, (P, A).
        """
        if not self.tried:
            return None
        for axis in range(left.shape[1]):
            if axis not in self.known:
                self.known[axis] = self._best_on(axis, left[:, axis])
        scored = [(found[0], axis, found[1:]) for axis, found in self.known.items() if found is not None]
        if not scored:
            return None
        _, axis, (i, j) = max(scored)
        several = (self.tried[i],) if i == j else (self.tried[i], self.tried[j])
        return axis, several

    def _best_on(self, axis: int, left: Array) -> tuple[float, int, int] | None:
        """Return quality and two conditions of the best place on an axis; equal if one is enough.

        Args:
            axis: Number of the axis.
            left: Unexplained error of the pieces on this axis that no place contains yet, (P,).
        """
        error, own = self._together(left), self.own[axis]
        part = self.time / self.length[:, None, None]
        even = part * self._halves(left)[:, None, None]
        quality = ((error - even) / np.sqrt(np.maximum(part, 1e-12))).min(axis=0)
        stands_out = (own >= STANDS_OUT * part * self.whole[:, axis, None, None]).all(axis=0)
        error, own = error.sum(axis=0), own.sum(axis=0)
        allowed = self.possible & (error >= MATERIAL_SHARE) & stands_out & (error >= NEW * own)
        alone = np.maximum(np.diag(quality), 0.0)
        simple = np.eye(len(alone), dtype=bool)
        allowed &= simple | (quality >= SIMPLER * np.maximum(alone[:, None], alone))
        if not allowed.any():
            return None
        i, j = np.unravel_index(np.where(allowed, quality, -np.inf).argmax(), quality.shape)
        return float(quality[i, j]), int(min(i, j)), int(max(i, j))
