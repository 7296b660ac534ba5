"""What changed between two recordings of a vehicle whose hull its file does not describe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import HULL, WEAK, damped, flown

from hydro.core.diagnosis import before as module
from hydro.core.diagnosis.before import ahead
from hydro.core.diagnosis.diagnose import diagnose, hull_of
from hydro.core.diagnosis.log_faults import preprocess
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


def test_a_change_with_which_the_file_predicts_worse_is_suspected_only(before, monkeypatch):
    errors = {False: [2.0, 1.0], True: [1.0, 2.0]}
    after, verdicts = flown(WEAK, seed=40), []
    for worse in (False, True):
        monkeypatch.setattr(module, "ahead", lambda log, vehicles, worse=worse: np.array(errors[worse]))
        found = diagnose(damped(), after, before=before).findings[0]
        verdicts.append(found.verdict)
        assert ("5 s ahead worse" in found.advice) is worse
    assert verdicts == ["missing", "suspect"]


def test_errors_ahead_are_of_the_recording(before):
    log = preprocess(damped(), before)
    right, wrong = ahead(log, [damped(HULL), damped()])
    assert right < 0.5 * wrong
    assert np.isnan(ahead(replace(log, raw=before.head(200)), [damped()])).all()


def test_nothing_changed(before):
    (found,) = diagnose(damped(), flown(seed=70), before=before).findings
    assert found.verdict == "nothing_missing"
    assert "nothing has changed beyond what the model of the hull leaves" in found.advice


def test_a_recording_before_that_is_too_short(before):
    with pytest.raises(DataError, match=r"too short|too few"):
        hull_of(damped(), before.head(1000))
