"""The hull that is learnt from a recording before; `tests/test_before_command.py` names changes beside it."""

from __future__ import annotations

import pytest
from recordings import damped, flown

from hydro.core.diagnosis.diagnose import hull_of
from hydro.core.errors import DataError


@pytest.fixture(scope="module")
def before():
    return flown(seed=10)


def test_the_hull_is_learnt(before):
    hull = hull_of(damped(), before)
    assert hull.left < 0.5 * hull.given, "the library takes most of the file's error away"


def test_a_recording_before_that_is_too_short(before):
    with pytest.raises(DataError, match=r"too short|too few"):
        hull_of(damped(), before.head(1000))
