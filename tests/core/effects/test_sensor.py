"""Delays of a velocity log that are tried."""

from __future__ import annotations

import numpy as np
from bench import BARE

from hydro.core.effects.sensor import LONGEST_DELAY, SENSOR_DELAY


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
