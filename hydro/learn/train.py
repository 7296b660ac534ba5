"""Training of a residual network: the protocol of Wu et al. (IV-C), or the same with a falling rate.

Inputs and outputs are standardised with the fitted rows.  Adam with weight decay 1e-5 minimises the mean
squared standardised error, and gradients are clipped to norm 5.  Training stops 30 epochs after the best one
at the latest.  A tenth of the training part's blocks is for validation (`rows.validation`); the test part
influences no decision.

The default protocol, `annealed`, differs from the paper in three details (docs/adr/0010 has their effects):

* The learning rate rises over the first twentieth of the updates and then falls to zero as a half cosine.
  The paper's starts at 1e-3 and falls at plateaus.
* Batches have at most 512 rows.
* The weight decay is decoupled from the gradient (AdamW).  As a part of the gradient it dominates once the
  gradient of the error is small, and then biases the wrench visibly in a replay.

The protocol `paper` is Adam with L2 regularisation in the gradient, and a learning rate that falls to a tenth
after `PLATEAU` epochs without improvement.  The paper states neither the batch size nor these numbers nor a
limit of epochs; batch and limit are those of the default protocol, and the others are PyTorch's defaults.

With labels from a noisy log, networks train without accelerations (`trusted_accelerations`), and with a
stronger weight decay.  It keeps them from fitting label noise, so 25,000 updates do not overfit.

Equal rows, seed and device give equal weights, bit for bit: the code uses deterministic algorithms, its own
shuffling, no clock, and one thread.  More threads would divide the sums over a batch and round differently;
use two cores to train two networks.  For the same reason there is a limit of epochs and none of time.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal, NamedTuple, get_args

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

UPDATES = 25_000  # default number of weight updates
MOST_EPOCHS = 60  # greatest default number of epochs
LEARNING_RATE = 4e-3  # greatest learning rate
WARM_UP = 0.05  # share of the updates over which the learning rate rises
WEIGHT_DECAY = 1e-5  # paper IV-C
WEIGHT_DECAY_NOISY = 0.2  # for labels from a noisy log
GRADIENT_NORM = 5.0  # clipping norm of gradients (paper IV-C)
PATIENCE = 30  # epochs without improvement before training stops (paper IV-C)
PAPER_RATE = 1e-3  # initial learning rate of the protocol `paper` (IV-C)
PLATEAU, REDUCED = 10, 0.1  # epochs without improvement before the learning rate falls, and its factor

Protocol = Literal["annealed", "paper"]

BATCHES_PER_EPOCH = 256  # few rows get small batches, so that an epoch has enough updates
BATCH_LIMITS = (64, 512)  # least and greatest rows of a batch
ROWS_PER_PASS = 16384  # rows per evaluation of a network, to limit memory
HIDDEN_SCALE = 1e12  # scale that makes an input negligible
TRUSTED = 0.01  # greatest noise of an acceleration that is an input, as a share of its spread


class Epoch(NamedTuple):
    """Progress report of one epoch of a training.

    Attributes:
        number: number of the epoch, from 1.
        limit: greatest number of epochs.
        loss: mean squared standardised error over the fitted rows during the epoch.
        validation_rmse: single figure of Wu et al. on the validation rows: the root mean square error over
            all rows and six axes [N and N m mixed].
        learning_rate: learning rate at the end of the epoch.
        best: whether the weights after this epoch are the best so far.
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


class _Plan(NamedTuple):
    """Schedule: greatest number of epochs, batch size, weight decay, seed of the row order, and protocol."""

    epochs: int
    batch: int
    decay: float
    seed: int
    protocol: Protocol


def train(
    table: pl.DataFrame,
    *,
    model: str = "physfeat",
    seed: int = 0,
    epochs: int | None = None,
    device: str = "cpu",
    accelerations: bool = True,
    centre: Sequence[float] | None = None,
    protocol: Protocol = "annealed",
    progress: Callable[[Epoch], None] | None = None,
) -> Model:
    """Train the network `model` on the training part of a split table.

    Args:
        table: labels with `block` and `part`, from `distillation.split`; guard and test rows are not used.
        model: name of an architecture, such as `physfeat`; `learn.networks` has all.
        seed: seed of the initial weights and of the row order.
        epochs: greatest number of epochs, over which the learning rate falls; early stopping may end sooner.
            By default as many as give 25,000 updates, at most 60.  The model `gp` uses neither epochs nor
            device.
        device: `cpu`, or `cuda` if available.
        accelerations: whether nu_dot is an input; use False for labels from a noisy log, for which
            `trusted_accelerations` is False.  False also selects the strong weight decay.
        centre: centre of gravity (3,) [m], FRD from CO, for `gp`; by default it is fitted.
        protocol: `annealed`, AdamW with a learning rate that falls as a half cosine; or `paper`, Adam with a
            rate that falls at plateaus, as in Wu et al.
        progress: called after every epoch; for `gp` after every step, with NaN errors.

    Returns:
        The model with the weights of the best epoch on the validation rows; `training` holds a summary.

    Raises:
        DataError: If the table has not been split, has too few training rows, lacks a column, or has one that
            is not finite.
        UsageError: If the model or the device does not exist, or the epochs or the seed are invalid.
    """
    if epochs is not None and epochs < 1:
        raise UsageError(f"epochs must be at least 1, not {epochs}")
    if protocol not in get_args(Protocol):
        raise UsageError(f"protocol must be annealed or paper, not '{protocol}'")
    seeds.check(seed)
    description = architecture(model)
    if description["model"] == "gp":
        return _train_gaussian_process(table, description, seed, centre, progress)
    target_device = _device(device)
    training, inputs = rows.inputs(table, "train", description)
    validating = rows.validation(training)
    targets = rows.wrenches(training)
    scalers = _scalers(inputs[~validating], targets[~validating])
    if not accelerations:
        _hide_accelerations(scalers, networks.inputs(description))
    fitted = _standardised(inputs[~validating], targets[~validating], scalers, target_device)
    watched = _standardised(inputs[validating], targets[validating], scalers, target_device)
    batch = int(np.clip(len(fitted.inputs) // BATCHES_PER_EPOCH, *BATCH_LIMITS))
    decay = WEIGHT_DECAY if accelerations else WEIGHT_DECAY_NOISY
    epochs = epochs or min(MOST_EPOCHS, math.ceil(UPDATES * batch / len(fitted.inputs)))
    with _reproducible(seed):
        network = build(description).to(target_device)
        network.standardise(scalers)
        summary = _run_epochs(network, fitted, watched, _Plan(epochs, batch, decay, seed, protocol), progress)
    summary |= {
        "rows": {"fitted": len(fitted.inputs), "validation": len(watched.inputs)},
        "parameters": parameter_count(network),
        "accelerations": accelerations,
        "protocol": protocol,
    }
    return _model(model, description, network, scalers, summary)


def _train_gaussian_process(
    table: pl.DataFrame,
    description: dict[str, Any],
    seed: int,
    centre: Sequence[float] | None,
    progress: Callable[[Epoch], None] | None,
) -> Model:
    """Fit the model of `learn.gaussian_process`, which has no epochs and validates on every block."""
    training, inputs = rows.inputs(table, "train", description)
    rows.validation(training)  # raises for data of one block
    targets = rows.wrenches(training)
    scalers = _scalers(inputs, targets)
    description["points"] = min(description["points"], len(inputs))

    def report(done: int, of: int) -> None:
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
            progress=report,
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


def _run_epochs(
    network: Residual,
    fitted: _Rows,
    watched: _Rows,
    plan: _Plan,
    progress: Callable[[Epoch], None] | None,
) -> dict[str, Any]:
    """Train for the planned epochs, load the best weights into the network, and return a summary.

    Args:
        network: Network with its scalers set.
        fitted: Training rows.
        watched: Validation rows, which choose the best weights.
        plan: Schedule of the training.
        progress: Called after every epoch.
    """
    epochs, batch, _, seed, protocol = plan
    updates = epochs * math.ceil(len(fitted.inputs) / batch)
    optimiser, schedule = _optimiser(network, plan, updates)
    plateau = torch.optim.lr_scheduler.ReduceLROnPlateau(optimiser, factor=REDUCED, patience=PLATEAU)
    order = torch.Generator().manual_seed(seed)
    best, best_error, weights = 0, np.inf, _copy(network)
    for number in range(1, epochs + 1):
        loss = _run_epoch(network, fitted, optimiser, schedule, batch=batch, order=order)
        error, rmse = _errors(network, watched)
        if not np.isfinite(loss + error):
            raise DataError(
                f"training: the error is no longer finite in epoch {number}: look for outliers in the labels"
            )
        if protocol == "paper":
            plateau.step(error)
        if error < best_error:
            best, best_error, best_rmse, weights = number, error, rmse, _copy(network)
        if progress is not None:
            rate = float(optimiser.param_groups[0]["lr"])
            progress(Epoch(number, epochs, loss, rmse, rate, best == number))
        if number - best >= PATIENCE:
            break
    network.load_state_dict(weights)
    return {"epochs": number, "best_epoch": best, "batch": batch, "validation_rmse": best_rmse}


def _optimiser(
    network: Residual, plan: _Plan, updates: int
) -> tuple[torch.optim.Optimizer, torch.optim.lr_scheduler.LambdaLR | None]:
    """Return the optimiser of a protocol, and its schedule by updates if it has one."""
    if plan.protocol == "paper":
        return torch.optim.Adam(network.parameters(), lr=PAPER_RATE, weight_decay=plan.decay), None
    optimiser = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=plan.decay)
    return optimiser, torch.optim.lr_scheduler.LambdaLR(optimiser, lambda done: annealed(done / updates))


def annealed(done: float) -> float:
    """Return the learning rate as a fraction of its maximum, after a fraction `done` of the updates."""
    if done < WARM_UP:
        return (done + 1e-3) / (WARM_UP + 1e-3)
    return 0.5 * (1.0 + math.cos(math.pi * (done - WARM_UP) / (1.0 - WARM_UP)))


def _run_epoch(
    network: Residual,
    fitted: _Rows,
    optimiser: torch.optim.Optimizer,
    schedule: torch.optim.lr_scheduler.LambdaLR | None,
    *,
    batch: int,
    order: torch.Generator,
) -> float:
    """Run one epoch in a new row order; return the mean loss over the rows."""
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
        if schedule is not None:
            schedule.step()
        total += loss.detach() * len(chosen)
    return total.item() / count


@torch.no_grad()
def _errors(network: Residual, watched: _Rows) -> tuple[float, float]:
    """Return the errors of a network on validation rows.

    Returns:
        Mean squared standardised error, and the root mean square error over all axes [N and N m mixed].
    """
    network.eval()
    squares = torch.zeros(watched.targets.shape[1], dtype=torch.float64, device=watched.targets.device)
    for start in range(0, len(watched.inputs), ROWS_PER_PASS):
        inputs, targets = (columns[start : start + ROWS_PER_PASS] for columns in watched)
        squares += (network.standardised(inputs) - targets).double().square().sum(dim=0)
    squares /= len(watched.inputs)
    return squares.mean().item(), (squares * network.output_scale.double().square()).mean().sqrt().item()


def _scalers(inputs: NDArray[np.float64], targets: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Return mean and scale of every column; a constant column has scale 1."""
    scalers = {}
    for side, columns in (("input", inputs), ("output", targets)):
        deviation = columns.std(axis=0)
        scalers[f"{side}_mean"] = columns.mean(axis=0)
        scalers[f"{side}_scale"] = np.where(deviation > 0.0, deviation, 1.0)
    return scalers


def trusted_accelerations(table: pl.DataFrame, noise: Sequence[float] | None = None) -> bool:
    """Return whether nu_dot of these labels has so little noise that it can be an input of a network.

    The label contains -M nu_dot.  Noise of nu_dot is therefore in the input and, times -M, in the label.  A
    network with nu_dot as input would learn to predict that noise, and its wrench would be wrong without
    noise.  Noise below a hundredth of the acceleration's spread, on every axis that moves, does no harm.

    Args:
        table: labels, with the velocities as they were logged.
        noise: standard deviation of each logged velocity, six numbers [m/s, rad/s]; by default estimated.
    """
    left = acceleration_sd(table, noise)
    spread = rows.states(labelled(table))[:, 6:].std(axis=0)
    return bool((left <= TRUSTED * spread)[spread > 0.0].all())


def _hide_accelerations(scalers: dict[str, NDArray[np.float64]], names: Sequence[str]) -> None:
    """Give the acceleration inputs so large a scale that they have no influence, in training and in use.

    Args:
        scalers: Means and scales of the inputs, changed in place.
        names: Names of the inputs; those of accelerations end with `_dot`.
    """
    hidden = [name.endswith("_dot") for name in names]
    scalers["input_mean"][hidden] = 0.0
    scalers["input_scale"][hidden] = HIDDEN_SCALE


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
    """Return the torch device; raise if `cuda` is not available."""
    if name not in ("cpu", "cuda"):
        raise UsageError(f"device must be cpu or cuda, not '{name}'")
    if name == "cuda" and not torch.cuda.is_available():
        raise UsageError("no CUDA device is available to torch on this machine: use --device cpu")
    return torch.device(name)


@contextmanager
def _reproducible(seed: int) -> Iterator[None]:
    """Seed torch and make its sums deterministic; restore all settings afterwards."""
    usual_threads, strict = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # makes cuBLAS deterministic
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        torch.use_deterministic_algorithms(True)
        try:
            yield
        finally:
            torch.use_deterministic_algorithms(strict)
            torch.set_num_threads(usual_threads)
