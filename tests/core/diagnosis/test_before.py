"""What changed between two recordings of a vehicle whose hull its file does not describe."""

from __future__ import annotations

import pytest
from recordings import WEAK, damped, flown

from hydro.core.diagnosis.diagnose import diagnose, hull_of
from hydro.core.errors import DataError


@pytest.fixture(scope="module")
def before():
    return flown(seed=10)


def test_the_hull_is_learnt_and_a_change_stands_alone(before):
    file = damped()
    hull = hull_of(file, before)
    assert hull.left < 0.5 * hull.given, "the library takes most of the file's error away"
    found = diagnose(file, flown(WEAK, seed=40), before=before).findings[0]
    assert (found.verdict, found.effect) == ("missing", "thruster_gain")
    assert found.parameters["g"] == pytest.approx([0.0, -0.3, *6 * [0.0]], abs=0.05)
    assert [error > 0.0 for error in found.standard_errors["g"]] == [False, True, *6 * [False]], (
        "thrusters that work are not estimated"
    )


def test_nothing_changed(before):
    (found,) = diagnose(damped(), flown(seed=70), before=before).findings
    assert found.verdict == "nothing_missing"
    assert "nothing has changed beyond what the model of the hull leaves" in found.advice


def test_a_recording_before_that_is_too_short(before):
    with pytest.raises(DataError, match=r"too short|too few"):
        hull_of(damped(), before.head(1000))
