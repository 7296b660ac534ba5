"""Change that begins within a recording, found by one linear step.

A change is fitted as constant over a recording.  One that begins in the third of four sessions then predicts
held-out sessions badly in both directions, so that it is named with wrong values or not found at all.  Here
each effect is fitted to the part after a boundary alone, for every boundary between held-out parts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hydro.core.diagnosis.contenders import Contest
from hydro.core.diagnosis.settings import CHANGED, FURTHER
from hydro.core.effects import CATALOGUE
from hydro.core.identification.suspects import suspects
from hydro.core.prediction.normal_equations import Normal


@dataclass(frozen=True)
class Onset:
    """Beginning of a change within a recording.

    Attributes:
        effect: Effect that describes the change best by one linear step.
        place: Where it begins, in words.
        gain: Share of the held-out squared residual that it removes, of that at the floor at least.
    """

    effect: str
    place: str
    gain: float

    @property
    def words(self) -> str:
        """Statement of the onset with the next step, for a finding's advice."""
        return (
            f"the vehicle or the water seems to have changed within the recording: {self.gain:.0%} of the "
            f"error goes if {self.effect.replace('_', ' ')} changes {self.place}. Values for the whole "
            "recording then mean little. Diagnose the parts before and after separately, or follow the "
            "change with `hydro track`"
        )


def onset(contest: Contest) -> Onset | None:
    """Return the beginning of a change that the vehicle of a contest lacks; None where none stands out.

    A change stands out if it removes as large a share of the error as a further change must, and CHANGED more
    than the best effect that acts in the whole recording.
    """
    compared, vehicle = contest.compared, contest.last.vehicle
    tried = suspects(vehicle, reach=compared.log.track)
    normal = contest.linearised(tried)
    throughout = max((score for score, _ in contest.scored(tried, normal).values()), default=0.0)
    least, found = max(throughout, 0.0) + CHANGED, None
    whole, floor = compared.cost(normal.of([])), compared.floor(contest.last)
    for number in np.unique(compared.fold)[1:]:
        scored = contest.scored(tried, _acting(normal, compared.fold >= number))
        for name, (score, _) in scored.items():
            gain = score * whole / max(whole, floor)
            if score > least and gain >= max(FURTHER, CATALOGUE[name].identification.absorbs):
                least, found = score, Onset(name, _place(contest, int(number)), gain)
    return found


def _acting(normal: Normal, where: np.ndarray) -> Normal:
    """Return a linear problem whose parameters act in a part of the shots alone, given by a mask (S,)."""
    gram = normal.gram.copy()
    gram[~where, :-1, :] = 0.0
    gram[~where, :, :-1] = 0.0
    return replace(normal, gram=gram)


def _place(contest: Contest, number: int) -> str:
    """Return where a held-out part begins, in words: the session's number, or the time within the session."""
    shots, fold = contest.compared.problem.shots, contest.compared.fold
    first = int(np.flatnonzero(fold == number)[0])
    numbers = np.unique(shots.session)
    if len(numbers) == fold.max() + 1:
        return f"in session {number + 1} of {len(numbers)}"
    return f"at t = {shots.record.t[shots.starts[first]]:.0f} s"
