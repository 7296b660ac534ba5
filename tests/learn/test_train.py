"""Training: protocol of the paper, use of the training part only, and reproducible bytes."""

from __future__ import annotations

import io

import numpy as np
import polars as pl
import pytest
import torch

from hydro.core.distillation.features import INPUTS, OUTPUTS, features
from hydro.core.errors import DataError, UsageError
from hydro.core.recording.smoothing import estimate, smooth
from hydro.core.residual.network import Network
from hydro.io import table as tables
from hydro.io.model import from_artefact, to_artefact
from hydro.learn import rows
from hydro.learn import train as training
from hydro.learn.evaluate import predict, predict_rows
from hydro.learn.networks import ARCHITECTURES
from hydro.learn.train import train, trusted_accelerations


def stored(model) -> bytes:
    """Return the bytes of the model's artefact."""
    file = io.BytesIO()
    tables.write(to_artefact(model, seed=0), file)
    return file.getvalue()


def noise(split: pl.DataFrame) -> pl.DataFrame:
    """Return the table with random labels."""
    rng = np.random.default_rng(9)
    return split.with_columns(pl.Series(name, rng.normal(size=split.height)) for name in OUTPUTS)


def with_bad(split: pl.DataFrame, part: str, column: str, value: float) -> pl.DataFrame:
    """Return the table with `value` in one column of one part."""
    return split.with_columns(
        pl.when(pl.col("part") == part).then(pl.lit(value)).otherwise(pl.col(column)).alias(column)
    )


def few(model: str) -> int:
    """Return rows for a short training: the time of a Gaussian process grows with their cube."""
    return 240 if model == "gp" else 600


@pytest.mark.usefixtures("short_searches")
@pytest.mark.parametrize("model", list(ARCHITECTURES))
def test_same_seed_same_bytes_whatever_torch_was_set_to(table, model):
    split = table(few(model))
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(1)
        torch.manual_seed(1)
        first = stored(train(split, model=model, seed=5, epochs=3))
        torch.set_num_threads(2)
        torch.manual_seed(2)
        second = stored(train(split, model=model, seed=5, epochs=3))
    finally:
        torch.set_num_threads(before)
    assert first == second
    assert first != stored(train(split, model=model, seed=6, epochs=3))


def test_training_leaves_torch_as_it_was(table):
    torch.manual_seed(7)
    state, threads = torch.get_rng_state(), torch.get_num_threads()
    train(table(400), model="mlp", epochs=1)
    assert torch.equal(state, torch.get_rng_state())
    assert threads == torch.get_num_threads()
    assert not torch.are_deterministic_algorithms_enabled()


def test_physfeat_learns_fossen_damping_and_coriolis_from_few_rows(table):
    split = table(4000, parts=("train", "train", "train", "test"))
    model = train(split, model="physfeat", epochs=25)
    test = rows.of_part(split, "test")
    truth = rows.wrenches(test)
    error = predict(model, rows.states(test)) - truth
    assert np.all(np.sqrt((error**2).mean(axis=0)) < 0.08 * truth.std(axis=0))


def test_the_structured_model_learns_them_from_few_rows_too(table):
    model = train(table(3000), model="structured", seed=1, epochs=20)
    held_back = rows.of_part(table(3000), "test")
    truth = rows.wrenches(held_back)
    error = predict(model, rows.states(held_back)) - truth
    assert (np.sqrt((error**2).mean(axis=0)) < 0.3 * truth.std(axis=0)).all()


def remembering(count: int = 1600) -> pl.DataFrame:
    """Return labels equal to the surge velocity 0.08 s earlier, unpredictable from (nu, nu_dot)."""
    rng = np.random.default_rng(2)
    states = rng.normal(size=(count, 12))
    targets = np.zeros((count, 6))
    targets[4:, 0] = 10.0 * states[:-4, 0]
    blocks = [f"{number // 100}" for number in range(count)]
    parts = ["test" if number // 100 % 4 == 3 else "train" for number in range(count)]
    columns = dict(zip((*INPUTS, *OUTPUTS), np.hstack([states, targets]).T, strict=True))
    return pl.DataFrame(columns | {"block": blocks, "part": parts}).with_columns(
        session=pl.lit("s"), t=pl.Series(0.02 * np.arange(count))
    )


def test_only_the_temporal_model_sees_the_past():
    split = remembering()
    for model, share in (("temporal", (0.0, 0.5)), ("mlp", (0.9, 2.0))):
        trained = train(split, model=model, epochs=12)
        chosen, predicted = predict_rows(trained, split)
        truth = rows.wrenches(chosen)[:, 0]
        error = np.sqrt(((predicted[:, 0] - truth) ** 2).mean()) / truth.std()
        assert share[0] <= error < share[1], model
    names = train(split, model="temporal", epochs=1).inputs
    assert names[11:14] == ("r_dot", "u-1", "v-1")


def test_the_temporal_model_needs_its_sample_time():
    split = remembering(400)
    with pytest.raises(DataError, match=r"not a multiple of the sample time of 0\.03 s"):
        train(split.with_columns(t=pl.col("t") * 1.5), model="temporal", epochs=1)
    with pytest.raises(DataError, match="column session is missing"):
        train(split.drop("session"), model="temporal", epochs=1)


def test_stored_model_predicts_what_the_trained_one_did(table):
    split = table(400)
    model = train(split, epochs=2)
    again = from_artefact(tables.read(io.BytesIO(stored(model)), "model"))
    np.testing.assert_array_equal(
        predict(again, rows.states(split)), predict(model, rows.states(split)), strict=True
    )
    assert again.training == model.training


@pytest.mark.parametrize("part", ["test", "guard"])
def test_rows_of_the_other_parts_do_not_reach_the_model(table, part):
    split = table(600)
    changed = with_bad(with_bad(split, part, "u_s", np.nan), part, "X_res", 1e9)
    assert stored(train(changed, epochs=2)) == stored(train(split, epochs=2))


@pytest.mark.usefixtures("short_searches")
@pytest.mark.parametrize("model", list(ARCHITECTURES))
def test_a_network_trained_blind_does_not_feel_accelerations(table, model):
    trained = train(table(few(model)), model=model, epochs=1, accelerations=False)
    states = np.random.default_rng(0).normal(size=(5, 12))
    faster = states + np.r_[np.zeros(6), np.full(6, 100.0)]
    np.testing.assert_allclose(predict(trained, faster), predict(trained, states), rtol=1e-5)
    np.testing.assert_allclose(
        Network.of(trained).wrench(faster), predict(trained, states), rtol=1e-4, atol=1e-3
    )


def logged(noise: float, count: int = 3000) -> pl.DataFrame:
    """Return labels of M nu_dot = -D nu, with white noise on the logged velocities."""
    rng = np.random.default_rng(3)
    t = 0.02 * np.arange(count)
    nu = np.stack([np.sin((0.3 + 0.1 * k) * t + k) for k in range(6)], axis=1)
    rate = np.stack([(0.3 + 0.1 * k) * np.cos((0.3 + 0.1 * k) * t + k) for k in range(6)], axis=1)
    measured = nu + noise * rng.normal(size=nu.shape)
    bounds = [[0, count]]
    motion = smooth(measured, bounds, estimate(measured, bounds, 0.02, [noise] * 6))
    label = 20.0 * nu + 50.0 * (rate - motion[:, :, 1])
    columns = np.hstack([measured, motion[:, :, 0], motion[:, :, 1], label])
    names = ("u", "v", "w", "p", "q", "r", *INPUTS, *OUTPUTS)
    parts = pl.Series(["train", "test"])[(np.arange(count) // 300) % 2]
    return pl.DataFrame(dict(zip(names, columns.T, strict=True))).with_columns(
        session=pl.lit("s"), t=pl.Series(t), block=pl.Series((np.arange(count) // 50).astype(str)), part=parts
    )


def test_accelerations_are_trusted_where_the_log_is_clean():
    assert trusted_accelerations(logged(0.0))
    assert not trusted_accelerations(logged(0.05))
    assert not trusted_accelerations(logged(0.05), [0.05] * 6)


def test_noise_that_is_in_input_and_label_is_learnt_unless_the_network_is_blind_to_it():
    noisy, clean = logged(0.1), logged(0.0)
    seeing, blind = (
        predict_rows(train(noisy, model="mlp", epochs=8, accelerations=seen), clean)[1]
        for seen in (True, False)
    )
    truth = rows.wrenches(clean.filter(pl.col("part") == "test"))
    errors = [np.sqrt(np.square(predicted - truth).mean()) for predicted in (seeing, blind)]
    assert errors[1] < 0.7 * errors[0]


def test_scalers_are_of_the_rows_fitted(table):
    split = table(600).with_columns(u_s=pl.lit(0.25))
    model = train(split, epochs=1)
    training_rows = rows.of_part(split, "train")
    fitted = training_rows.filter(~rows.validation(training_rows))
    inputs = features(fitted.select(INPUTS).to_numpy(), "physfeat")
    np.testing.assert_allclose(model.scalers["input_mean"], inputs.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(model.scalers["output_scale"], fitted.select(OUTPUTS).to_numpy().std(axis=0))
    assert model.scalers["input_scale"][0] == 1.0, "a column that never changes keeps its scale"
    assert model.training["rows"] == {
        "fitted": fitted.height,
        "validation": training_rows.height - fitted.height,
    }


def test_model_says_what_goes_in_and_out_and_in_which_unit(table):
    model = train(table(400), epochs=1)
    assert model.inputs[12:14] == ("u|u|", "v|v|")
    assert model.outputs == OUTPUTS
    assert model.units["u_dot"] == "m/s^2"
    assert model.units["u|u|"] == "m^2/s^2"
    assert model.units["N_res"] == "N m"


def test_progress_tells_every_epoch_and_the_best_one_is_kept(table):
    split, told = table(600), []
    model = train(split, epochs=8, progress=told.append)
    assert [epoch.number for epoch in told] == list(range(1, 9))
    assert all(epoch.limit == 8 for epoch in told)
    assert told[-1].loss < told[0].loss
    best = [epoch for epoch in told if epoch.best][-1]
    assert model.training["best_epoch"] == best.number
    assert model.training["validation_rmse"] == best.validation_rmse
    training_rows = rows.of_part(split, "train")
    watched = training_rows.filter(rows.validation(training_rows))
    error = predict(model, rows.states(watched)) - rows.wrenches(watched)
    assert np.sqrt((error**2).mean()) == pytest.approx(best.validation_rmse, rel=1e-5)


def test_training_ends_when_patience_does(table, monkeypatch):
    monkeypatch.setattr(training, "PATIENCE", 3)
    told = []
    model = train(noise(table(600)), epochs=60, progress=told.append)
    assert model.training["epochs"] == model.training["best_epoch"] + 3 == len(told) < 60


def test_the_learning_rate_rises_and_falls_to_nothing_as_a_half_cosine(table):
    told = []
    train(table(600), epochs=20, progress=told.append)
    rates = np.array([epoch.learning_rate for epoch in told]) / training.LEARNING_RATE
    share = (np.arange(1, 21) / 20 - training.WARM_UP) / (1.0 - training.WARM_UP)
    np.testing.assert_allclose(rates, np.cos(0.5 * np.pi * share) ** 2, atol=1e-12)
    early = [training.annealed(done) for done in np.linspace(0.0, training.WARM_UP, 50)]
    assert 0.0 < early[0] < 0.05
    assert early == sorted(early)


def test_epochs_make_so_many_updates_where_none_are_given(table, monkeypatch):
    monkeypatch.setattr(training, "UPDATES", 30)
    model = train(table(600))
    batches = -(-model.training["rows"]["fitted"] // model.training["batch"])
    assert model.training["epochs"] == -(-30 // batches)
    monkeypatch.setattr(training, "MOST_EPOCHS", 2)
    assert train(table(600)).training["epochs"] == 2


def test_unsplit_labels_are_refused(table):
    with pytest.raises(DataError, match="column part is missing: split the labels first with `hydro split`"):
        train(table(400).drop("part"))


def test_no_training_rows_are_refused(table):
    with pytest.raises(DataError, match="no row belongs to the train part"):
        train(table(400, parts=("test",)))


def test_a_single_training_block_is_refused(table):
    with pytest.raises(DataError, match="needs two blocks or more"):
        train(table(100, parts=("train", "test")))


@pytest.mark.parametrize("column", ["w_dot", "K_res"])
@pytest.mark.parametrize("value", [np.nan, np.inf, None])
def test_numbers_that_are_not_finite_are_named(table, column, value):
    with pytest.raises(DataError, match=rf"{column} must be finite: 200 of 200 rows.*row 0") as caught:
        train(with_bad(table(400), "train", column, value))
    assert "\n" not in str(caught.value)


def test_a_missing_column_is_named(table):
    with pytest.raises(DataError, match="column q_dot is missing"):
        train(table(400).drop("q_dot"))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"epochs": 0}, "at least 1"),
        ({"device": "tpu"}, "cpu or cuda"),
        ({"model": "x"}, "no model is called"),
    ],
)
def test_wrong_options_are_refused(table, wrong, message):
    with pytest.raises(UsageError, match=message):
        train(table(400), **wrong)


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a CUDA device")
def test_cuda_is_refused_where_there_is_none(table):
    with pytest.raises(UsageError, match="no CUDA device"):
        train(table(400), device="cuda")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device on this machine")
def test_cuda_gives_the_same_bytes_twice_and_a_model_of_the_processor(table):
    split = table(600)
    first = train(split, epochs=3, device="cuda")
    assert stored(first) == stored(train(split, epochs=3, device="cuda"))
    on_processor = train(split, epochs=3)
    assert first.training["validation_rmse"] == pytest.approx(
        on_processor.training["validation_rmse"], rel=1e-2
    )
