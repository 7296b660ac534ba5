"""Motion between the samples of sensors, and where there is no sensor."""

from __future__ import annotations

import numpy as np

from hydro.core.recording.filling import filled


def test_attitude_and_rates_alone_leave_the_rest_at_rest():
    """A vehicle without depth sensor, position or DVL."""
    t = np.arange(60) * 0.05
    motion = np.full((60, 12), np.nan)
    motion[:, 3:6] = np.stack([0.1 * np.sin(t), 0.2 * np.cos(t), t], axis=1)
    motion[:, 9:] = 0.3
    out = filled(motion, np.array([[0, 60]]), 0.05)
    np.testing.assert_array_equal(out[:, 3:6], motion[:, 3:6])
    np.testing.assert_array_equal(out[:, [0, 1, 2, 6, 7, 8]], 0.0)


def test_without_position_and_velocity_a_vehicle_turns_where_it_stands():
    t = np.arange(50) * 0.05
    motion = np.full((50, 12), np.nan)
    motion[:, 3:6] = np.stack([0.0 * t, 0.0 * t, 0.2 * t], axis=1)
    out = filled(motion, np.array([[0, 50]]), 0.05)
    np.testing.assert_allclose(out[:, 11], 0.2, atol=1e-6)
    np.testing.assert_array_equal(out[:, :3], 0.0)
    np.testing.assert_array_equal(out[:, 6:9], 0.0)
