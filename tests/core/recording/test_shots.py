"""Shots: what is known of a beginning at sight."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from recordings import damped, moved

from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import TRUST, Shots, make_shots


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


def test_what_a_sea_hides_is_the_root_of_its_information():
    """(1 - B B^T)^2 = (1 + X X^T)^-1, of what was seen; what was not is as it was."""
    rng = np.random.default_rng(0)
    swell, sigma = rng.standard_normal((2, 5, 12, 3)), rng.uniform(0.5, 2.0, 12)
    for seen in (None, rng.random((2, 7, 12)) < 0.6):
        shots = SimpleNamespace(swell=swell, sigma=sigma, seen=seen, lead=2, residuals=60)
        hidden = Shots.hidden.func(cast(Any, shots))
        for k in range(2):
            x = swell[k] / sigma[:, None]
            if seen is not None:
                x = np.where(seen[k, 2:, :, None], x, 0.0)
            x = x.reshape(60, 3)
            root = np.eye(60) - hidden[k] @ hidden[k].T
            np.testing.assert_allclose(root @ root @ (np.eye(60) + x @ x.T), np.eye(60), atol=1e-9)
