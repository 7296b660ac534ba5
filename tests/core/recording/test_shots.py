"""Shots: what is known of a beginning at sight."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import polars as pl
import pytest
from recordings import damped, moved, noisy

from hydro.core.recording.arrays import recording, smoothed
from hydro.core.recording.shots import TRUST, Shots, make_shots, smoothing_error


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


def test_the_first_part_of_shots_has_their_first_rows_only():
    shots = make_shots(recording(damped(), moved(damped(), rows=500)), lead=0.1)
    seen = np.ones((len(shots.starts), shots.length, 12), bool)
    shots = replace(shots, seen=seen, swell=np.ones((len(seen), shots.length - shots.lead, 12, 2)))
    part = shots.first_part(0.25)
    assert part.seconds == pytest.approx(0.24)
    assert part.length == shots.lead + 13
    np.testing.assert_array_equal(part.measured, shots.measured[:, : part.length])
    np.testing.assert_array_equal(part.seen, seen[:, : part.length])
    assert part.swell.shape[1] == 13
    np.testing.assert_array_equal(part.first, shots.first)
    assert shots.first_part(5.0) is shots


def test_an_anchored_initial_state_counts_at_most_as_a_sample():
    """Its deviation is not below the noise or its true error; at the log's edge or unsampled it is free."""
    calm = moved(damped(), rows=1000)
    shots, exact = (make_shots(recording(damped(), raw)) for raw in (noisy(calm, 0), calm))
    assert shots.anchor is None
    anchor = shots.anchored().anchor
    np.testing.assert_array_equal(anchor[0], 0.0)
    assert (anchor[1:] <= 1.0 / shots.sigma).all()
    assert (anchor[1:] > 0.4 / shots.sigma).all()
    error = (shots.first - exact.measured[:, 0])[1:, [0, 1, 2, *range(7, 13)]]
    assert (np.sqrt(np.mean(error**2, axis=0)) < 1.0 / np.delete(anchor[1], range(3, 6))).all()
    seen = np.ones((len(shots.starts), shots.length, 12), bool)
    seen[1, :, 7] = False
    seen[2, 5:, 2] = False
    expected = anchor.copy()
    expected[1, 7] = 0.0
    part = replace(shots, seen=seen, record=replace(shots.record, seen=np.ones((1000, 12), bool)))
    np.testing.assert_allclose(part.anchored().anchor, expected)
    np.testing.assert_array_equal(part.anchored().of(np.arange(len(anchor)) > 1).anchor, expected[2:])


def test_the_states_of_a_slow_sensor_are_uncertain_between_its_samples():
    raw = moved(damped(), rows=1000)
    rows = pl.int_range(pl.len())
    slow = recording(damped(), raw.with_columns(u=pl.when(rows % 25 == 0).then("u")))
    error = np.abs(smoothed(slow)[1][:, 0] - raw["u"].to_numpy())
    assert 1.0 < smoothing_error(slow, *smoothed(slow))[6] / np.sqrt(np.mean(error**2)) < 10.0


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
