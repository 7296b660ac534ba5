"""Training of a residual network after the paper's protocol (IV-C), with a learning rate that is annealed.

Inputs and outputs are standardised on the rows that are fitted; Adam with weight decay 1e-5 minimises the
mean square of the standardised error; gradients are clipped to norm 5; training ends 30 epochs after the
best, or with its last. A tenth of the training part's blocks validates (`rows.validation`): the test part
takes no part in any decision.

Three things differ from the paper. The learning rate rises over the first twentieth of the updates and then
falls to nothing as a half cosine, where the paper's waits for plateaus from 1e-3 on; batches are of 512 rows
at most; and the weight decay is decoupled from the gradient (AdamW). As a part of the gradient it is all that
moves weights where the error's own has become small, and bends the wrench enough to be seen in a replay.
docs/adr/0010 has what each is worth.

From a noisy log networks are trained blind to accelerations (`trusted_accelerations`), and with a weight
decay that keeps them from learning the noise of their labels: 25,000 updates then do no harm.

The same rows, seed and device give the same weights to the last bit: deterministic algorithms, own shuffling,
no clock, and one thread (threads share out the sums over a batch, so that another number rounds otherwise):
on two cores train two networks. A limit of time would break this promise, so there is only one of epochs.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import polars as pl
import torch
from numpy.typing import NDArray
from torch import Tensor

from hydro.core import seeds
from hydro.core.distillation.features import OUTPUTS
from hydro.core.distillation.labels import acceleration_sd, labelled
from hydro.core.errors import DataError, UsageError
from hydro.io import schema
from hydro.io.model import Model
from hydro.learn import gaussian_process, networks, rows
from hydro.learn.networks import architecture, build, parameter_count
from hydro.learn.networks.residual import AXES, Residual

UPDATES = 25_000  # of the weights, where the number of epochs is not given
MOST_EPOCHS = 60  # then
LEARNING_RATE = 4e-3
WARM_UP = 0.05  # share of the updates
WEIGHT_DECAY = 1e-5
WEIGHT_DECAY_NOISY = 0.2  # from a noisy log
GRADIENT_NORM = 5.0
PATIENCE = 30

BATCHES_PER_EPOCH = 256  # few rows get small batches, so that an epoch is always a fair number of steps
BATCH_LIMITS = (64, 512)
ROWS_PER_PASS = 16384
UNSEEN = 1e12  # scale of an input that the network is not to see: whatever it is, it counts as nothing
TRUSTED = 0.01  # share of an acceleration that noise may be for it still to be seen


class Epoch(NamedTuple):
    """What is reported after an epoch.

    Attributes:
        number: of the epoch, from 1.
        limit: number of epochs that training lasts at most.
        loss: mean square standardised error over the rows fitted, while they were.
        validation_rmse: the paper's single figure on the validation rows, the root mean square of the error
            over all rows and six axes as they are [N and N m mixed].
        learning_rate: that the epoch ended with.
        best: whether its weights are the best so far.
    """

    number: int
    limit: int
    loss: float
    validation_rmse: float
    learning_rate: float
    best: bool


class _Rows(NamedTuple):
    """Standardised inputs (N, k) and targets (N, 6)."""

    inputs: Tensor
    targets: Tensor


class _Course(NamedTuple):
    """Epochs at most, rows of a batch, weight decay, and the seed of the order of the rows."""

    epochs: int
    batch: int
    decay: float
    seed: int


def train(
    table: pl.DataFrame,
    *,
    model: str = "physfeat",
    seed: int = 0,
    epochs: int | None = None,
    device: str = "cpu",
    accelerations: bool = True,
    centre: Sequence[float] | None = None,
    progress: Callable[[Epoch], None] | None = None,
) -> Model:
    """Train the network `model` on the training part of a split table.

    Args:
        table: labels with `block` and `part`, see `distillation.split`; guard and test rows are left alone.
        model: name of an architecture, see `learn.networks`.
        seed: of the first weights and of the order of the rows.
        epochs: passes over the rows at most, over which the learning rate falls; early stopping may end
            sooner. By default as many as make 25,000 updates of the weights, 60 at most. The model `gp` knows
            none, and no device either.
        device: `cpu`, or `cuda` where there is one.
        accelerations: whether nu_dot is an input of the network; not from a noisy log, see
            `trusted_accelerations`, for which the weight decay is strong besides.
        centre: centre of gravity (3,) [m], FRD from CO, for `gp`; by default it is found from the labels.
        progress: called after every epoch, or step of `gp`, whose errors are NaN.

    Returns:
        The weights of the epoch that did best on the validation rows; `training` holds a summary.

    Raises:
        DataError: If the table has not been split, has too few training rows, lacks a column, or has one that
            is not finite.
        UsageError: If the model or the device is not there, the epochs are not positive, or the seed is none.
    """
    if epochs is not None and epochs < 1:
        raise UsageError(f"epochs must be at least 1, not {epochs}")
    seeds.check(seed)
    description = architecture(model)
    if description["model"] == "gp":
        return _process(table, description, seed, centre, progress)
    target_device = _device(device)
    training, inputs = rows.inputs(table, "train", description)
    validating = rows.validation(training)
    targets = rows.wrenches(training)
    scalers = _scalers(inputs[~validating], targets[~validating])
    if not accelerations:
        _hide(scalers, networks.inputs(description))
    fitted = _standardised(inputs[~validating], targets[~validating], scalers, target_device)
    watched = _standardised(inputs[validating], targets[validating], scalers, target_device)
    batch = int(np.clip(len(fitted.inputs) // BATCHES_PER_EPOCH, *BATCH_LIMITS))
    decay = WEIGHT_DECAY if accelerations else WEIGHT_DECAY_NOISY
    epochs = epochs or min(MOST_EPOCHS, math.ceil(UPDATES * batch / len(fitted.inputs)))
    with _reproducible(seed):
        network = build(description).to(target_device)
        network.standardise(scalers)
        summary = _fit(network, fitted, watched, _Course(epochs, batch, decay, seed), progress)
    summary |= {
        "rows": {"fitted": len(fitted.inputs), "validation": len(watched.inputs)},
        "parameters": parameter_count(network),
        "accelerations": accelerations,
    }
    return _model(model, description, network, scalers, summary)


def _process(
    table: pl.DataFrame,
    description: dict[str, Any],
    seed: int,
    centre: Sequence[float] | None,
    progress: Callable[[Epoch], None] | None,
) -> Model:
    """The model of `learn.gaussian_process`, which is found without epochs and validates on every block."""
    training, inputs = rows.inputs(table, "train", description)
    rows.validation(training)  # refuses data of one block
    targets = rows.wrenches(training)
    scalers = _scalers(inputs, targets)
    description["points"] = min(description["points"], len(inputs))

    def told(done: int, of: int) -> None:
        if progress is not None:
            progress(Epoch(done, of, math.nan, math.nan, math.nan, False))

    with _reproducible(seed):
        blocks = training["block"].to_list()
        found = gaussian_process.fit(
            inputs[:, :AXES],
            targets,
            blocks,
            points=description["points"],
            seed=seed,
            centre=centre,
            progress=told,
        )
        network = build(description)
        network.standardise(scalers)
        network.load_state_dict({name: torch.from_numpy(value) for name, value in found.tensors.items()})
    summary = {
        "validation_rmse": found.left_out_rmse,
        "rows": {"fitted": len(inputs), "validation": len(inputs)},
        "parameters": parameter_count(network),
        "accelerations": False,
    }
    return _model(description["model"], description, network, scalers, summary)


def _fit(
    network: Residual,
    fitted: _Rows,
    watched: _Rows,
    course: _Course,
    progress: Callable[[Epoch], None] | None,
) -> dict[str, Any]:
    """Run the epochs, leave the best weights in the network and return the summary."""
    epochs, batch, decay, seed = course
    optimiser = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=decay)
    updates = epochs * math.ceil(len(fitted.inputs) / batch)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimiser, lambda done: annealed(done / updates))
    order = torch.Generator().manual_seed(seed)
    best, best_error, weights = 0, np.inf, _copy(network)
    for number in range(1, epochs + 1):
        loss = _pass(network, fitted, optimiser, schedule, batch=batch, order=order)
        error, rmse = _errors(network, watched)
        if not np.isfinite(loss + error):
            raise DataError(
                f"training: the error is no longer finite in epoch {number}: look for outliers in the labels"
            )
        if error < best_error:
            best, best_error, best_rmse, weights = number, error, rmse, _copy(network)
        if progress is not None:
            rate = float(schedule.get_last_lr()[0])
            progress(Epoch(number, epochs, loss, rmse, rate, best == number))
        if number - best >= PATIENCE:
            break
    network.load_state_dict(weights)
    return {"epochs": number, "best_epoch": best, "batch": batch, "validation_rmse": best_rmse}


def annealed(done: float) -> float:
    """The learning rate after a share of the updates, as a share of its largest."""
    if done < WARM_UP:
        return (done + 1e-3) / (WARM_UP + 1e-3)
    return 0.5 * (1.0 + math.cos(math.pi * (done - WARM_UP) / (1.0 - WARM_UP)))


def _pass(
    network: Residual,
    fitted: _Rows,
    optimiser: torch.optim.Optimizer,
    schedule: torch.optim.lr_scheduler.LambdaLR,
    *,
    batch: int,
    order: torch.Generator,
) -> float:
    """Go once over all rows in a new order; return the mean loss over the rows."""
    network.train()
    count = len(fitted.inputs)
    total = torch.zeros((), device=fitted.inputs.device)
    shuffled = torch.randperm(count, generator=order).to(fitted.inputs.device)
    for start in range(0, count, batch):
        chosen = shuffled[start : start + batch]
        error = network.standardised(fitted.inputs[chosen]) - fitted.targets[chosen]
        loss = error.square().mean()
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(network.parameters(), GRADIENT_NORM)
        optimiser.step()
        schedule.step()
        total += loss.detach() * len(chosen)
    return total.item() / count


@torch.no_grad()
def _errors(network: Residual, watched: _Rows) -> tuple[float, float]:
    """Return the mean square standardised error, and the root mean square error as it is."""
    network.eval()
    squares = torch.zeros(watched.targets.shape[1], dtype=torch.float64, device=watched.targets.device)
    for start in range(0, len(watched.inputs), ROWS_PER_PASS):
        inputs, targets = (columns[start : start + ROWS_PER_PASS] for columns in watched)
        squares += (network.standardised(inputs) - targets).double().square().sum(dim=0)
    squares /= len(watched.inputs)
    return squares.mean().item(), (squares * network.output_scale.double().square()).mean().sqrt().item()


def _scalers(inputs: NDArray[np.float64], targets: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Means and scales of every column; a column that never changes keeps its scale."""
    scalers = {}
    for side, columns in (("input", inputs), ("output", targets)):
        deviation = columns.std(axis=0)
        scalers[f"{side}_mean"] = columns.mean(axis=0)
        scalers[f"{side}_scale"] = np.where(deviation > 0.0, deviation, 1.0)
    return scalers


def trusted_accelerations(table: pl.DataFrame, noise: Sequence[float] | None = None) -> bool:
    """Whether nu_dot of these labels is free enough of noise to be an input of a network.

    The label holds -M nu_dot. What noise leaves in nu_dot is therefore in the input and, times -M, in the
    label: a network with nu_dot as input learns to predict that noise, and distorts its wrench as much where
    there is none. Noise below a hundredth of the acceleration's spread, on every axis that moves, does no
    harm.

    Args:
        table: labels, with the velocities as they were logged.
        noise: standard deviation of each logged velocity, six numbers [m/s, rad/s]; by default estimated.
    """
    left = acceleration_sd(table, noise)
    spread = rows.states(labelled(table))[:, 6:].std(axis=0)
    return bool((left <= TRUSTED * spread)[spread > 0.0].all())


def _hide(scalers: dict[str, NDArray[np.float64]], names: Sequence[str]) -> None:
    """Scale the accelerations among the inputs to nothing, in training as in use."""
    hidden = [name.endswith("_dot") for name in names]
    scalers["input_mean"][hidden] = 0.0
    scalers["input_scale"][hidden] = UNSEEN


def _standardised(
    inputs: NDArray[np.float64],
    targets: NDArray[np.float64],
    scalers: dict[str, NDArray[np.float64]],
    device: torch.device,
) -> _Rows:
    def tensor(columns: NDArray[np.float64], side: str) -> Tensor:
        scaled = columns - scalers[f"{side}_mean"]
        scaled /= scalers[f"{side}_scale"]
        return torch.from_numpy(scaled.astype(np.float32)).to(device)

    return _Rows(tensor(inputs, "input"), tensor(targets, "output"))


def _copy(network: Residual) -> dict[str, Tensor]:
    return {name: tensor.clone() for name, tensor in network.state_dict().items()}


def _model(
    name: str,
    description: dict[str, Any],
    network: Residual,
    scalers: dict[str, NDArray[np.float64]],
    summary: dict[str, Any],
) -> Model:
    made_of = networks.inputs(description)
    units = {field.name: field.unit or "1" for field in schema.load("features").fields}
    return Model(
        name=name,
        architecture=description,
        tensors={key: tensor.cpu().numpy() for key, tensor in network.state_dict().items()},
        features=description["features"],
        scalers=scalers,
        inputs=made_of,
        outputs=OUTPUTS,
        units={column: units[column.split("-")[0]] for column in (*made_of, *OUTPUTS)},
        training=summary,
    )


def _device(name: str) -> torch.device:
    """Return the device, `cuda` only where there is one."""
    if name not in ("cpu", "cuda"):
        raise UsageError(f"device must be cpu or cuda, not '{name}'")
    if name == "cuda" and not torch.cuda.is_available():
        raise UsageError("no CUDA device is available to torch on this machine: use --device cpu")
    return torch.device(name)


@contextmanager
def _reproducible(seed: int) -> Iterator[None]:
    """Seed torch and make its sums repeatable, and put everything back afterwards."""
    usual_threads, strict = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # without it cuBLAS does not repeat itself
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        torch.use_deterministic_algorithms(True)
        try:
            yield
        finally:
            torch.use_deterministic_algorithms(strict)
            torch.set_num_threads(usual_threads)
