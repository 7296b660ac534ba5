"""Shots: what is known of a beginning at sight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from recordings import damped, moved

from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import TRUST, make_shots


def test_less_is_known_of_a_beginning_where_a_shot_has_no_sample_of_a_channel():
    shots = make_shots(recording(damped(), moved(damped(), rows=250)))
    np.testing.assert_array_equal(shots.trust, TRUST)
    seen = np.ones((len(shots.starts), shots.length, 12), bool)
    seen[0, :, 7] = False
    seen[1, 5:, 2] = False
    trust = replace(shots, seen=seen).trust
    expected = np.tile(TRUST, (len(shots.starts), 1))
    expected[0, 7] *= 5.0
    np.testing.assert_allclose(trust, expected)
