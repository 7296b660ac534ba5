"""What a hull does beside its file, learnt from simulations of a vehicle that does it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from recordings import damped, moved

from hydro.core.prediction.candidate import candidate
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.residual import library
from hydro.core.residual.hull import stretches
from hydro.core.residual.regression import learn
from hydro.core.residual.response import Transitions, covered

VEHICLE = damped()
MORE = {"name": "linear_damping", "diagonal": [6.0, 0.0, 0.0, 0.0, 0.0, 0.0]}


@pytest.fixture(scope="module")
def shots():
    """Of a vehicle that surge damps more than its file says."""
    record = recording(VEHICLE, moved(damped(MORE), rows=3000))
    return make_shots(record, sigma=np.full(12, 1e-3))


@pytest.mark.parametrize("first", [0, 1, 2])
def test_no_sample_is_left_out_where_samples_are_rarer_than_rows(shots, first):
    """Every third row has a sample: no choice of rows may miss them all."""
    seen = np.zeros((len(shots.starts), shots.length, 12), bool)
    seen[:, first::3] = True
    rare = dataclasses.replace(shots, seen=seen)
    whole, found = (
        learn(VEHICLE, Transitions.of(candidate(VEHICLE), some), stretches(some)) for some in (shots, rare)
    )
    assert np.linalg.norm(found.coefficients) > 0.5 * np.linalg.norm(whole.coefficients)


def test_beyond_the_motion_that_it_was_learnt_from_a_wrench_stays_what_it_is_at_the_edge(shots):
    """Within it nothing changes; of a motion that is all beyond, it is constant."""
    law = learn(VEHICLE, Transitions.of(candidate(VEHICLE), shots), stretches(shots))
    whole = law.wrench(VEHICLE, shots)
    anywhere = dataclasses.replace(law, low=np.full(15, -np.inf), high=np.full(15, np.inf))
    np.testing.assert_array_equal(whole, anywhere.wrench(VEHICLE, shots))
    nowhere = dataclasses.replace(law, low=law.high, high=law.high).wrench(VEHICLE, shots)
    np.testing.assert_allclose(nowhere, np.tile(nowhere[0], (len(nowhere), 1)))
    fast = dataclasses.replace(shots, nu=3.0 * shots.nu)
    most = np.abs(whole).max()
    assert np.abs(law.wrench(VEHICLE, fast)).max() < 1.5 * most
    assert np.abs(anywhere.wrench(VEHICLE, fast)).max() > 2.5 * most


def test_a_wrench_is_the_sum_of_the_terms_in_every_row(monkeypatch, shots):
    """Also where a recording has more rows than are computed together."""
    law = learn(VEHICLE, Transitions.of(candidate(VEHICLE), shots), stretches(shots))
    terms = library.terms(library.Flow.of(candidate(VEHICLE), shots).within(law.low, law.high))
    monkeypatch.setattr(library, "ROWS_TOGETHER", 700)
    assert len(terms) > 700
    np.testing.assert_allclose(law.wrench(VEHICLE, shots), terms @ law.coefficients, rtol=1e-12, atol=1e-12)
    without = list(law.left_out_wrenches(VEHICLE, shots))
    assert len(without) == len(law.left_out) > 1
    for wrench, coefficients in zip(without, law.left_out, strict=True):
        np.testing.assert_allclose(wrench, terms @ coefficients, rtol=1e-12, atol=1e-12)


def test_in_the_rows_of_shots_a_wrench_is_that_of_the_whole_recording(shots):
    """Rows outside the shots are not computed; the terms in the shots are those of the recording."""
    few = shots.of(np.arange(len(shots.starts)) % 3 == 1)
    law = learn(VEHICLE, Transitions.of(candidate(VEHICLE), shots), stretches(shots))
    inside, whole = covered(few), law.wrench(VEHICLE, few)
    assert inside.sum() == few.starts.size * few.length < len(inside)
    there = law.wrench(VEHICLE, few, inside)
    np.testing.assert_allclose(there[inside], whole[inside], rtol=1e-12, atol=1e-12)
    assert not there[~inside].any()
    found = law.terms(candidate(VEHICLE), few) @ law.coefficients
    np.testing.assert_allclose(found.reshape(-1, 6), whole[inside], rtol=1e-12, atol=1e-12)


def test_some_shots_are_corrected_as_among_all(shots):
    transitions = Transitions.of(candidate(VEHICLE), shots)
    wrench = np.random.default_rng(0).normal(size=(shots.record.rows, 6))
    kept = np.arange(len(shots.starts)) % 3 == 1
    few = transitions.over(kept).corrected(wrench)
    np.testing.assert_array_equal(few.measured, transitions.corrected(wrench).measured[kept])
    np.testing.assert_array_equal(few.starts, shots.starts[kept])
