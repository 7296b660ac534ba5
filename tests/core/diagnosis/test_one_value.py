"""One gain for all thrusters, as of a lower supply voltage, in every regime of the diagnosis."""

from __future__ import annotations

import polars as pl
import pytest
from recordings import damped, flown, moved, noisy

from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.pipeline import diagnose, diagnose_log, hull_of
from hydro.core.identification.suspects import with_one_value

WEAKER = -0.1
ALL = {"name": "thruster_gain", "g": [WEAKER] * 8}


def common(found):
    """Return the common gain of the only finding with values, and its standard error."""
    (one,) = (each for each in found.findings if each.parameters)
    assert one.is_confirmed
    assert one.effect == "thruster_gain"
    return one.parameters["common"], one.standard_errors["common"]


def test_equal_gains_at_the_noise_are_one_value():
    sessions = [
        noisy(moved(damped(ALL), seed=i, rows=2000), i).with_columns(session=pl.lit(f"s{i}"))
        for i in range(3)
    ]
    gain, error = common(diagnose(damped(), pl.concat(sessions)))
    assert gain == pytest.approx(WEAKER, abs=3.0 * error)


def test_equal_gains_since_an_earlier_recording_are_one_value():
    hull = hull_of(damped(), flown(seed=10))
    log = preprocess(damped(), flown(ALL, seed=20), hull)
    gain, error = common(diagnose_log(damped(), log, hull=hull))
    assert gain == pytest.approx(WEAKER, abs=3.0 * error)


def test_gains_of_the_file_keep_their_own_values():
    """They may differ from thruster to thruster."""
    assert with_one_value(damped(ALL), "thruster_gain", damped()) == {
        "name": "thruster_gain",
        "common": pytest.approx(WEAKER),
    }
    assert with_one_value(damped(ALL), "thruster_gain", damped(ALL)) is None
    assert with_one_value(damped({"name": "net_buoyancy", "dB": 1.0}), "net_buoyancy", damped()) is None
