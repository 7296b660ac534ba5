"""Gaussian process: learning from little data, and from mirrored motion by port-starboard symmetry."""

from __future__ import annotations

from functools import cache

import numpy as np
import polars as pl
import pytest

from hydro.core.distillation.features import INPUTS, OUTPUTS
from hydro.core.errors import DataError
from hydro.core.residual.network import Network
from hydro.learn import gaussian_process, rows
from hydro.learn.evaluate import predict
from hydro.learn.train import train


def cubic(nu: np.ndarray) -> np.ndarray:
    """Return drag proportional to the cube of the speed, along the direction of motion, (N, 6)."""
    arms = np.array([1.0, 1.0, 1.0, 0.2, 0.5, 0.5])
    drag = np.array([60.0, 150.0, 200.0, 5.0, 20.0, 15.0])
    speed = np.sqrt(((nu * arms) ** 2).sum(axis=1, keepdims=True))
    wrench = drag * speed**2 * nu + 10.0 * drag.mean() / 100.0 * arms * nu
    wrench[:, 5] += 30.0 * speed[:, 0] * nu[:, 0] * nu[:, 1]
    return wrench


def recorded(count: int, seed: int = 0, starboard: bool = False) -> pl.DataFrame:
    """Return a split table of motions in that water, optionally with motion to starboard only."""
    rng = np.random.default_rng(seed)
    nu = rng.normal(size=(count, 6)) * [0.5, 0.4, 0.4, 0.3, 0.2, 0.4]
    if starboard:
        nu[:, 1] = abs(nu[:, 1])
    states = np.hstack([nu, rng.normal(size=(count, 6))])
    columns = np.hstack([states, cubic(nu)]).T
    return pl.DataFrame(dict(zip((*INPUTS, *OUTPUTS), columns, strict=True))).with_columns(
        session=pl.lit("s"),
        t=pl.Series(0.02 * np.arange(count)),
        block=pl.Series([f"{number // 10}" for number in range(count)]),
        part=pl.lit("train"),
    )


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(gaussian_process, "ROWS_VARIANCES", 200)
    monkeypatch.setattr(gaussian_process, "ROWS_CENTRE", 100)
    monkeypatch.setattr(gaussian_process, "STEPS", 8)


@cache
def learnt(count: int):
    """Return the model of so many rows of motion, trained once."""
    return train(recorded(count), model="gp", seed=3)


def missed(model, nu: np.ndarray) -> np.ndarray:
    """Return root mean square errors by axis, relative to the size of the wrench, (6,)."""
    truth = cubic(nu)
    error = predict(model, np.hstack([nu, np.zeros_like(nu)])) - truth
    return np.sqrt((error**2).mean(axis=0) / (truth**2).mean(axis=0))


def test_it_finds_the_growth_of_drag_from_few_rows():
    model = learnt(400)
    nu = np.random.default_rng(7).normal(size=(500, 6)) * [0.5, 0.4, 0.4, 0.3, 0.2, 0.4]
    assert (missed(model, nu) < 0.06).all()
    assert model.architecture["points"] == 400
    assert model.training["accelerations"] is False


def test_what_holds_to_starboard_holds_to_port():
    model = train(recorded(400, starboard=True), model="gp")
    nu = np.random.default_rng(7).normal(size=(500, 6)) * [0.5, 0.4, 0.4, 0.3, 0.2, 0.4]
    nu[:, 1] = -abs(nu[:, 1])
    assert (missed(model, nu) < 0.1).all()


def test_fossen_s_damping_and_coriolis_are_learnt_too(table):
    split = table(1600)
    model = train(split, model="gp")
    test = rows.of_part(split, "test")
    truth = rows.wrenches(test)
    error = predict(model, rows.states(test)) - truth
    assert (np.sqrt((error**2).mean(axis=0)) < 0.05 * truth.std(axis=0)).all()


def test_the_error_of_what_was_left_out_is_told_in_newtons():
    split = recorded(400)
    size = np.sqrt((rows.wrenches(split) ** 2).mean())
    assert 0.0 < learnt(400).training["validation_rmse"] < 0.05 * size


def test_the_compiled_wrench_is_torch_s():
    model = learnt(300)
    states = np.random.default_rng(1).normal(size=(50, 12))
    expected = predict(model, states)
    np.testing.assert_allclose(
        Network.of(model).wrench(states), expected, atol=1e-5 * abs(expected).max(), rtol=1e-5
    )


def test_the_same_seed_gives_the_same_weights():
    one, two = learnt(300), train(recorded(300), model="gp", seed=3)
    for name, tensor in one.tensors.items():
        np.testing.assert_array_equal(tensor, two.tensors[name], err_msg=name)


def test_neighbouring_blocks_are_left_out_together_where_there_are_many():
    fold = gaussian_process._folds([f"{number // 2}" for number in range(600)])
    assert fold.max() + 1 == gaussian_process.FOLDS
    assert (np.diff(fold) >= 0).all()
    assert gaussian_process._folds(list("aabb")).tolist() == [0, 0, 1, 1]


def test_one_block_cannot_be_left_out():
    with pytest.raises(DataError, match="two blocks or more"):
        train(recorded(10), model="gp")
