"""A DVL off the origin, and delays of one that are tried."""

from __future__ import annotations

import numpy as np
from bench import BARE, equipped

from hydro.core.effects import velocity_log
from hydro.core.effects.sensor import LONGEST_DELAY, SENSOR_DELAY, measured


def test_fine_delays_refine_the_coarse_ones_as_far_as_a_log_is_late():
    """Where a coarse delay tells of the effect, a fit may begin there or closer to what is true."""
    known = SENSOR_DELAY.identification
    coarse, fine = (
        [shape.tables[0]["d"] for shape in made(BARE, None)] for made in (known.coarse, known.fine) if made
    )
    assert set(coarse) < set(fine)
    tried = np.log([*fine, LONGEST_DELAY])
    assert np.diff(tried).max() < np.diff(np.log([*coarse, LONGEST_DELAY])).max()
    assert (np.diff(tried) > 0.0).all()


def test_a_velocity_log_off_the_origin_reads_the_velocity_of_its_place():
    arm, turning = np.array([0.5, -0.2, 0.3]), np.array([0.1, 0.2, -0.3])
    log = velocity_log(equipped({"name": "sensor_lever_arm", "r": arm.tolist()}))
    read = measured(log, np.zeros(1), np.r_[np.zeros(3), turning][None])
    np.testing.assert_allclose(read[0], [*np.cross(turning, arm), *turning], atol=1e-12)
