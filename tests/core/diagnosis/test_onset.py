"""Changes that begin within a recording: a thruster that weakens between two sessions."""

from __future__ import annotations

import polars as pl
import pytest
from recordings import WEAK, damped, flown

from hydro.core.diagnosis.contenders import Compared, Contest
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.onset import onset
from hydro.core.diagnosis.pipeline import diagnose_log, hull_of

FROM_THIRD = pl.col("session") >= "s2"


@pytest.fixture(scope="module")
def hull():
    return hull_of(damped(), flown(seed=10))


@pytest.fixture(scope="module")
def weakened():
    """Two sessions of the unchanged vehicle, and two with a weak thruster."""
    return pl.concat([flown(seed=20).filter(~FROM_THIRD), flown(WEAK, seed=20).filter(FROM_THIRD)])


def begun(raw, hull):
    """Return the onset in a recording, beside a hull that is known already."""
    file = hull.completed(damped())
    compared, first = Compared.of(file, preprocess(damped(), raw), hull)
    return onset(Contest(compared, first))


def test_a_thruster_that_weakens_between_sessions_is_dated(weakened, hull):
    """Its gain is no constant of the recording, so none is confirmed."""
    found = diagnose_log(damped(), preprocess(damped(), weakened), hull=hull)
    (told,) = (one.advice for one in found.findings if one.verdict == "none_of_the_known")
    assert "thruster gain changes in session 3 of 4" in told
    assert not any(one.is_confirmed for one in found.findings)
    assert any("session 3 of 4" in sentence for sentence in found.status.sentences)


def test_thrust_that_falls_steadily_is_told(hull):
    """The gains of four sessions fall from 1 to 0.4."""
    falling = [
        flown({"name": "thruster_gain", "g": [-0.2 * number] * 8}, seed=20).filter(
            pl.col("session") == f"s{number}"
        )
        for number in range(4)
    ]
    found = begun(pl.concat(falling), hull)
    assert found.effect == "thruster_gain"
    assert found.place == "at a constant rate throughout"


@pytest.mark.parametrize("changes", [(), (WEAK,)], ids=["unchanged", "weak throughout"])
def test_a_constant_vehicle_has_no_onset(hull, changes):
    assert begun(flown(*changes, seed=20), hull) is None


def test_an_onset_within_one_session_is_told_by_its_time(weakened, hull):
    """The four parts are one session of 100 s each, with gaps."""
    place = pl.col("session").rank("dense").cast(pl.Float64) - 1.0
    one = weakened.with_columns(pl.col("t") + 100.0 * place, pl.lit("a").alias("session"))
    found = begun(one, hull)
    assert found.effect == "thruster_gain"
    assert found.place.startswith("at t = ")
    assert 190.0 <= float(found.place.split()[3]) <= 216.0
