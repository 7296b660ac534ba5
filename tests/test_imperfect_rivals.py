"""The rivals find what a plain log shows, and predict with what they found."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from benchmarks.hidden_effects import flights, vehicles
from benchmarks.hidden_effects.build import build
from benchmarks.rivals import contest, output_error, regression
from hydro.core.evaluation.replay_error import Ahead

GIVEN = vehicles.preset("bluerov2_heavy")


@pytest.fixture(scope="module")
def logs():
    """Two sessions, and one held out, of a vehicle with 20 N too much buoyancy."""
    hidden = [{"name": "net_buoyancy", "dB": 20.0}]
    flown = flights.independent(
        GIVEN, GIVEN, hidden, {}, rows=[1000, 1000, 800], depth=15.0, noise=0.5, seed=8
    )
    return pl.concat(flown[:2]), flown[2]


def numbers(plant):
    """All numbers of a plant, those of its parts too."""
    return [value for one in plant for value in (numbers(one) if isinstance(one, tuple) else [one])]


def test_the_model_of_output_error_is_that_of_the_file(logs):
    _, held_out = logs
    errors = Ahead(held_out, GIVEN)
    plant = build(GIVEN)
    assert output_error.error(plant, errors) == pytest.approx(errors.of(GIVEN), rel=0.02)
    groups = output_error.parameters(GIVEN)
    count = sum(group.scales.size for group in groups)
    same = output_error.changed(plant, groups, np.zeros(count))
    assert all(np.allclose(one, other) for one, other in zip(numbers(plant), numbers(same), strict=True))


def test_regression_names_a_plain_force_and_predicts_better_for_it(logs):
    measured, held_out = logs
    found = regression.answer(GIVEN, measured)
    assert found.name == "net_buoyancy"
    errors = Ahead(held_out, GIVEN)
    assert found.error(errors, held_out) < 0.5 * errors.of(GIVEN)


@pytest.mark.slow
def test_output_error_predicts_better_for_its_fit(logs, monkeypatch):
    monkeypatch.setattr(output_error, "SHOTS", 4)
    monkeypatch.setattr(output_error, "SECONDS", 2.0)
    monkeypatch.setattr(output_error, "EVALUATIONS", 6)
    measured, held_out = logs
    found = output_error.answer(GIVEN, measured)
    assert found.name in {"", *(group.name for group in output_error.parameters(GIVEN))}
    errors = Ahead(held_out, GIVEN)
    assert found.error(errors, held_out) < 0.7 * errors.of(GIVEN)


def test_without_a_correction_the_residual_network_predicts_as_the_file(logs):
    from benchmarks.rivals import residual_network

    _, held_out = logs
    errors, plant = Ahead(held_out, GIVEN), build(GIVEN)
    held = contest.Held.of(errors, held_out)
    wrench = np.zeros((errors.record.rows, 6))
    predicted = residual_network.predicted(plant, lambda x: np.zeros((len(x), 6)), wrench, held)
    expected = output_error.predicted(plant, held)
    assert np.allclose(predicted, expected, atol=1e-6)
    pushed = residual_network.predicted(plant, lambda x: np.full((len(x), 6), 0.1), wrench, held)
    assert np.allclose(pushed[:, 1, 2] - expected[:, 1, 2], 0.1 * errors.record.dt, atol=1e-9)


def test_sindy_recovers_sparse_coefficients_and_names_terms(logs):
    pytest.importorskip("pysindy")
    from benchmarks.rivals import sindy

    rng = np.random.default_rng(2)
    terms, truth = rng.normal(size=(2000, 40)), np.zeros((6, 40))
    truth[np.arange(6), np.arange(6)] = -2.0
    truth[2, 30] = 1.0
    target = terms @ truth.T + 0.01 * rng.normal(size=(2000, 6))
    assert np.abs(sindy.sparse(terms, target) - truth).max() < 0.02
    measured, held_out = logs
    found = sindy.answer(GIVEN, measured)
    assert found.name == "net_buoyancy"
    assert np.isfinite(found.error(Ahead(held_out, GIVEN), held_out))


def mujocos():
    """MuJoCo's rival, where the extra `mujoco[sysid]` is installed; without it the package is empty."""
    for needed in ("absl", "tabulate", "colorama"):
        pytest.importorskip(needed)
    from benchmarks.rivals import mujoco_sysid

    return mujoco_sysid


def test_mujocos_rival_is_the_rigid_body_and_its_thrusters_where_there_is_no_water():
    rival = mujocos()
    bare = vehicles.preset("bluerov2_heavy")
    for name in {str(table["name"]) for table in bare.effect}:
        bare = bare.without(name)
    flown = flights.independent(bare, bare, [], {}, rows=[300], depth=15.0, noise=0.1, seed=3)[0]
    errors = Ahead(flown, bare)
    unchanged = {group.name: np.zeros(group.scales.size) for group in rival.groups(bare)}
    model = rival.scene(bare, errors.record.dt, unchanged).compile()
    model.opt.density = model.opt.viscosity = 0.0
    at_rest = np.zeros((1, errors.record.rows, 6))[:, : round(5.0 / errors.record.dt) + 1]
    assert rival.error(model, bare, errors, flown) < 0.02 * contest.weighed(errors, np.array([0]), at_rest)


@pytest.mark.slow
def test_mujocos_rival_predicts_better_for_its_fit(logs, monkeypatch):
    rival = mujocos()
    monkeypatch.setattr(rival, "SHOTS", 8)
    monkeypatch.setattr(rival, "ITERATIONS", 3)
    measured, held_out = logs
    errors = Ahead(held_out, GIVEN)
    assert rival.answer(GIVEN, measured).error(errors, held_out) < 0.6 * errors.of(GIVEN)


def test_turning_by_small_angles_is_a_rotation():
    sindy = pytest.importorskip("benchmarks.rivals.sindy")
    R = np.tile(np.eye(3), (2, 1, 1))
    out = sindy.turned(R, np.array([[0.0, 0.0, np.pi / 2], [0.3, -0.2, 0.1]]))
    assert out[0] @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0])
    assert out[1].T @ out[1] == pytest.approx(np.eye(3))


def test_what_leaves_all_bounds_counts_as_far_off(logs):
    _, held_out = logs
    errors = Ahead(held_out, GIVEN)
    starts = contest.ahead(errors)
    exact = errors.record.nu[starts[:, None] + np.arange(251)]
    assert contest.weighed(errors, starts, exact) == 0.0
    assert contest.weighed(errors, starts, np.full_like(exact, np.nan)) > 50.0
