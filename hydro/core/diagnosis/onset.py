"""Change within a recording, sudden or steady, found by one linear step.

A change is fitted as constant over a recording.  One that begins in the third of four sessions then predicts
held-out sessions badly in both directions, so that it is named with wrong values or not found at all.  Here
each effect is fitted with a course in time: from each boundary between held-out parts on, or growing at a
constant rate, such as the loss of thrust while a battery empties.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from hydro.core.columns import Array
from hydro.core.diagnosis.contenders import Contest, is_further, relative_gain
from hydro.core.diagnosis.settings import CHANGED
from hydro.core.identification.suspects import suspects
from hydro.core.prediction.normal_equations import Normal


@dataclass(frozen=True)
class Onset:
    """Change within a recording.

    Attributes:
        effect: Effect that describes the change best by one linear step.
        place: When it changes, in words.
        gain: Share of the held-out squared residual that it removes, of that at the floor at least.
    """

    effect: str
    place: str
    gain: float

    @property
    def words(self) -> str:
        """Statement of the change with the next step, for a finding's advice."""
        return (
            f"the vehicle or the water seems to have changed within the recording: {100.0 * self.gain:.0f} % "
            f"of the error goes if {self.effect.replace('_', ' ')} changes {self.place}. Values for the "
            "whole recording then mean little. Diagnose its parts separately, or follow the change with "
            "`hydro track`"
        )


def onset(contest: Contest) -> Onset | None:
    """Return the change within a recording that a contest's last vehicle lacks; None where none stands out.

    A change stands out if it removes the share of the error that a further change needs.  It must also remove
    CHANGED more than the best constant effect.
    """
    compared, vehicle = contest.compared, contest.last.vehicle
    tried = suspects(vehicle, reach=compared.log.track)
    normal = contest.linearised(tried)
    constant = max((score for score, _ in contest.scored(tried, normal).values()), default=0.0)
    least, found = max(constant, 0.0) + CHANGED, None
    whole, floor = compared.cost(normal.of([])), compared.floor(contest.last)
    for place, course in _courses(contest):
        for name, (score, _) in contest.scored(tried, _following(normal, course)).items():
            gain = relative_gain(score, whole, floor)
            if score > least and is_further(name, gain):
                least, found = score, Onset(name, place, gain)
    return found


def _courses(contest: Contest) -> Iterator[tuple[str, Array]]:
    """Yield courses in time, in words and as factors on a change at each of S shots, (S,).

    A steady change begins at zero, or is zero in the middle where the vehicle has its mean already.
    """
    shots, fold = contest.compared.problem.shots, contest.compared.fold
    sessions = len(np.unique(shots.session))
    for beginning in (0.0, -1.0):
        yield "at a constant rate throughout", np.linspace(beginning, 1.0, len(fold))
    numbers, first = np.unique(fold, return_index=True)
    for number, shot in zip(numbers[1:], first[1:], strict=True):
        time = f"at t = {shots.record.t[shots.starts[shot]]:.0f} s"
        place = f"in session {number + 1} of {sessions}" if sessions == len(numbers) else time
        yield place, (fold >= number).astype(float)


def _following(normal: Normal, course: Array) -> Normal:
    """Return a linear problem whose parameters follow a course, a factor for each of S shots, (S,)."""
    gram = normal.gram.copy()
    gram[:, :-1, :] *= course[:, None, None]
    gram[:, :, :-1] *= course[:, None, None]
    return replace(normal, gram=gram)
