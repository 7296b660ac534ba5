"""A DVL that is late: what it shows at the beginning of a shot was so before it."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from recordings import damped, moved, noisy

from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.model import unfitted
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import LONGEST_SENSOR_DELAY

LATE = 0.36
DELAY = {"name": "sensor_delay", "d": LATE}


def late(raw: pl.DataFrame) -> pl.DataFrame:
    """The recording with u, v, w as they were LATE seconds before; the first readings are held."""
    t = raw["t"].to_numpy()
    return raw.with_columns(
        pl.Series(name, np.interp(t - LATE, t, raw[name].to_numpy())) for name in ("u", "v", "w")
    )


@pytest.fixture(scope="module")
def recorded():
    return noisy(late(moved(damped(), rows=4000)), 1)


def test_kinematics_measure_the_delay_of_the_dvl(recorded):
    assert preprocess(damped(), recorded).lateness == pytest.approx(LATE, abs=0.01)
    assert preprocess(damped(), noisy(moved(damped(), rows=4000), 1)).lateness == 0.0


def test_the_right_model_reaches_the_noise_with_late_velocities(recorded):
    """Without what was before a shot it left half as much again, and no name could be stated."""
    log, right = preprocess(damped(), recorded), damped(DELAY)
    shots = log.shots(2.0)
    assert shots.lead * log.record.dt == pytest.approx(LONGEST_SENSOR_DELAY)
    assert unfitted(right, OutputError.of(shots, right)).normal.chi2 == pytest.approx(1.0, abs=0.05)


def test_the_audit_corrects_late_velocities(recorded):
    """Late accelerations lag behind the commands that made them: thrusters seemed weaker."""
    log = preprocess(damped(), recorded)
    assert log.audit is not None
    assert not log.audit.wrong
    np.testing.assert_allclose(log.audit.effectiveness, 1.0, atol=0.1)
