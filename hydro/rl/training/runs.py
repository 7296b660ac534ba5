"""Folder of a training: its tables, and the checkpoint from which it continues after an interruption.

    run.parquet          all settings, with the vehicle file in its footer
    model.parquet        residual model, if the condition has one
    covariance.parquet   covariance of the vehicle file's parameters, if there is one
    curves.parquet       learning curves
    evaluations.parquet  results of the policy without exploration
    policy.parquet       current policy
    policy-TASK.parquet  policy that passed the last level of a task
    checkpoint.pt        complete state of the training

Each table is written atomically, and the checkpoint last, at every evaluation or less often.  A training that
continues writes all tables since the checkpoint again, so an interruption between them does no harm.  No file
contains a time: equal settings give equal bytes.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TypedDict

import msgspec
import numpy as np
import polars as pl
import torch

from hydro.core.errors import DataError
from hydro.io import model as models
from hydro.io import sealed, table
from hydro.io.files import explained
from hydro.io.table import Artefact
from hydro.rl.environment.encoding import Encoding
from hydro.rl.training.config import TrainingConfig
from hydro.rl.training.policy import Policy
from hydro.rl.training.train import Training
from hydro.rl.world import choices

RUN, MODEL, POLICY, CHECKPOINT = "run.parquet", "model.parquet", "policy.parquet", "checkpoint.pt"
COVARIANCE = "covariance.parquet"
CURVES, EVALUATIONS = "curves.parquet", "evaluations.parquet"
STAGE = "rl train"
AGAIN = "perhaps an earlier version wrote it: train again with `hydro rl train`"
RENAMED = {"ladder": "curriculum"}
"""Groups of settings that version 0.1 called otherwise, with their present names."""
ADDED = {
    "recipe": '""',
    "checkpoint": "1",
    "settings.engine": '"mujoco"',
    "settings.step": "0.01",
    "wrench.lead": "0.5",
    "wrench.ratio": "1000000.0",
    "wrench.beta": "null",
    "wrench.clip": "null",
    "wrench.deadband": "null",
    "curriculum.row": "[]",
    "sac.delay": "1",
    "sac.correlation": "0.0",
}
"""Settings that earlier versions lacked, with the JSON values that describe how those versions behaved."""


def run_artefact(config: TrainingConfig, vehicle_text: str, *sources: Artefact | None) -> Artefact:
    """Return the table of a training's settings, with its vehicle file and other inputs as provenance.

    Args:
        config: The settings.
        vehicle_text: Text of the vehicle file.
        sources: Residual model, covariance of the file's parameters, and the policy to start from.
    """
    known = choices.flat(config)
    frame = pl.DataFrame({"name": list(known), "value": list(known.values())})
    inputs = [one for one in sources if one is not None]
    return table.make(
        "run", frame, stage=STAGE, seed=config.seed, inputs=inputs, vehicle_text=vehicle_text,
        parameters={"recipe": config.recipe, "condition": config.condition, "engine": config.settings.engine},
    )  # fmt: skip


def config_of(run: Artefact) -> TrainingConfig:
    """Return the settings stored in the table of a run.

    Raises:
        DataError: The table was written by a version with other settings.
    """
    given = {current_name(name): value for name, value in run.frame.select("name", "value").iter_rows()}
    given = ADDED | given
    if strange := sorted(given.keys() ^ choices.flat(TrainingConfig()).keys()):
        # A missing setting must not take its default: the version without it behaved otherwise.
        raise DataError(
            f"run: not a training of this version: setting {strange[0]} is missing or unknown: train again"
        )
    try:
        return choices.built(TrainingConfig, given)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise DataError(f"run: not a training of this version ({error}): train again") from error


def changed(config: TrainingConfig, given: Mapping[str, str]) -> TrainingConfig:
    """Return a copy of a config with the named settings replaced.

    Args:
        config: The config.
        given: JSON values by dotted name, such as `{"sac.batch": "256"}`; old names are accepted.

    Raises:
        UsageError: A name is unknown, or its value is invalid.
    """
    return choices.changed(config, {current_name(name): value for name, value in given.items()})


def current_name(name: str) -> str:
    """Return the present dotted name of a setting, given its name in this or an earlier version."""
    group, dot, rest = name.partition(".")
    return f"{RENAMED.get(group, group)}{dot}{rest}"


class Folder:
    """Folder that stores a training: tables, policies and checkpoint.

    Attributes:
        path: Path of the folder.
    """

    def __init__(self, path: Path) -> None:
        """Store the path; nothing is read or written."""
        self.path = path

    def state(self, run: Artefact) -> dict[str, Any] | None:
        """Return the state of the training from the checkpoint, to continue from; None without a checkpoint.

        Args:
            run: Table of the settings; the steps and the curriculum may differ from the earlier run.

        Raises:
            DataError: The folder belongs to another training, or its content is broken.
        """
        if (self.path / RUN).exists():
            self._require_same(run)
        if not (self.path / CHECKPOINT).exists():
            return None
        return _read_state(self.path / CHECKPOINT)

    def begin(self, run: Artefact, model: Artefact | None, covariance: Artefact | None = None) -> None:
        """Create the folder, and write settings and copies of residual model and covariance to the folder.

        Call this method after the training was constructed.  Otherwise invalid settings would leave a folder
        that blocks a valid training.

        Args:
            run: Table of the training's settings.
            model: Residual model; None without one.
            covariance: Covariance of the vehicle file's parameters; None without one.

        Raises:
            DataError: The operating system refuses.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise explained(str(self.path), error) from error
        table.write(run, self.path / RUN)
        for copied, name in ((model, MODEL), (covariance, COVARIANCE)):
            if copied is not None:
                table.write(copied, self.path / name)

    def _require_same(self, run: Artefact) -> None:
        before = self.run()
        old, new = config_of(before), config_of(run)
        longer = replace(old, steps=new.steps, curriculum=new.curriculum)
        if longer != new or before.provenance.inputs != run.provenance.inputs:
            now = choices.flat(new)
            changed = [name for name, value in choices.flat(longer).items() if value != now[name]]
            names = ", ".join(changed)
            raise DataError(
                f"{self.path}: holds a training with other {names or 'inputs'}: give another folder, or the "
                "same choices to continue"
            )

    def save(self, training: Training, run: Artefact) -> None:
        """Write the tables of a training and its policies, then its checkpoint if one is due.

        Args:
            training: The training.
            run: Table of its settings, which becomes an input of every table.
        """
        config, tables = training.config, training.tables()
        for kind, name in (("curves", CURVES), ("evaluations", EVALUATIONS)):
            made = table.make(kind, tables[kind], stage=STAGE, seed=config.seed, inputs=[run])
            table.write(made, self.path / name)
        table.write(policy_artefact(training.policy(), run, config.seed), self.path / POLICY)
        for task, policy in training.task_policies.items():
            table.write(policy_artefact(policy, run, config.seed), self._task_policy(task))
        if training.checkpoint_due:
            _write_state(training.state(), self.path / CHECKPOINT)

    def config(self) -> TrainingConfig:
        """Return the settings of the training that the folder stores."""
        return config_of(self.run())

    def evaluations(self) -> Artefact:
        """Return the table of the policy's evaluations without exploration, one row per evaluation.

        Raises:
            DataError: The table is missing or broken.
        """
        return table.read(self.path / EVALUATIONS, "evaluations")

    def run(self) -> Artefact:
        """Return the table of the training's settings.

        Raises:
            DataError: The table is missing or broken.
        """
        return table.read(self.path / RUN, "run")

    def model(self) -> Artefact | None:
        """Return the table of the residual model of the condition; None if the condition has none."""
        return table.read(self.path / MODEL, "model") if (self.path / MODEL).exists() else None

    def covariance(self) -> Artefact | None:
        """Return the table of the covariance of the vehicle file's parameters; None if there is none."""
        there = (self.path / COVARIANCE).exists()
        return table.read(self.path / COVARIANCE, "covariance") if there else None

    def learnt(self) -> dict[str, Any]:
        """Return the `state` of the learner from the checkpoint, from which another training can start.

        Raises:
            DataError: The checkpoint is missing or broken.
        """
        if not (self.path / CHECKPOINT).exists():
            raise DataError(f"{self.path}: no {CHECKPOINT} to start from: give the folder of a training")
        learner: dict[str, Any] = _read_state(self.path / CHECKPOINT)["learner"]
        return learner

    def policy(self, task: str | None = None) -> tuple[Policy, Artefact]:
        """Return a policy of the training, and the table that stores it.

        Args:
            task: Return the policy that passed this task, if one did; by default the current policy.

        Raises:
            DataError: The policy is missing or broken.
        """
        of_task = None if task is None else self._task_policy(task)
        found = table.read(of_task if of_task and of_task.exists() else self.path / POLICY, "policy")
        return policy_of(found), found

    def _task_policy(self, task: str) -> Path:
        return self.path / f"policy-{task}.parquet"


class Reached(TypedDict):
    """Progress of a training as stored with a policy; newer policies also state `recipe` and `updates`.

    Attributes:
        steps: Number of control steps of all vehicles together.
        task: Name of the task that the training has reached.
        level: Level of the task.
    """

    steps: int
    task: str
    level: int


class DescribedPolicy(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Description of a policy in the footer of its table.

    Attributes:
        widths: Widths of the network's hidden layers.
        scale: Typical size of each observation, in the unit of the observation.
        fades: Whether each observation x is a range, which the network gets as exp(-x/scale).
        training: Progress of the training.
    """

    widths: Annotated[tuple[models.Width, ...], msgspec.Meta(max_length=64)]
    scale: tuple[float, ...]
    fades: tuple[bool, ...]
    training: Reached


def policy_artefact(policy: Policy, run: Artefact, seed: int) -> Artefact:
    """Return a table of a policy's tensors, with a description of the policy in its footer.

    Args:
        policy: The policy.
        run: Table of its training's settings, which becomes an input in the provenance.
        seed: Seed of the training.
    """
    tensors = policy.weights
    frame = pl.DataFrame(
        {
            "tensor": list(tensors),
            "shape": [list(each.shape) for each in tensors.values()],
            "data": [each.ravel() for each in tensors.values()],
        },
        schema={"tensor": pl.String, "shape": pl.List(pl.Int64), "data": pl.List(pl.Float32)},
    )
    described = {
        "widths": list(policy.widths),
        "scale": policy.encoding.scale.tolist(),
        "fades": policy.encoding.fades.tolist(),
        "training": dict(policy.training),
    }
    return table.make("policy", frame, stage=STAGE, seed=seed, inputs=[run]).of_network(described)


def policy_of(artefact: Artefact) -> Policy:
    """Return the policy stored in a table of kind `policy`.

    Raises:
        DataError: The footer does not describe a policy.
    """
    described = models.described(artefact, DescribedPolicy, AGAIN)
    return Policy(
        described.widths,
        Encoding(np.array(described.scale, np.float32), np.array(described.fades, np.bool_)),
        models.tensors(artefact),
        (artefact.provenance.model or {})["training"],
    )


def _write_state(state: dict[str, Any], path: Path) -> None:
    """Write a state atomically, with its hash."""
    with sealed.writing(path) as stream:
        torch.save(_interned(_each(state, np.ndarray, torch.from_numpy)), stream)


def _read_state(path: Path) -> dict[str, Any]:
    """Read a state; the learner's tensors stay tensors, all others become arrays.

    Raises:
        DataError: The file is broken.
    """
    try:
        with sealed.reading(path) as stream:
            state = torch.load(stream, weights_only=True)
        learner = state.pop("learner")
    except DataError as error:
        raise DataError(f"{error}: remove it to train again") from error
    except Exception as error:  # any error of torch's unpickler, or a state without a learner
        raise DataError(
            f"{path}: cannot be read: remove it to train again ({type(error).__name__})"
        ) from error
    return {**_each(state, torch.Tensor, torch.Tensor.numpy), "learner": learner}


def _interned(nested: Any) -> Any:
    """Return a copy of nested values in which equal texts are one object.

    Pickle writes an object once and refers to it afterwards.  Texts read back from a file are other objects
    than those of the program.  Without interning, a continued training would write other bytes than an
    uninterrupted one.
    """
    if isinstance(nested, str):
        return sys.intern(nested)
    if isinstance(nested, dict):
        return {_interned(name): _interned(value) for name, value in nested.items()}
    if isinstance(nested, list | tuple):
        return type(nested)(_interned(value) for value in nested)
    return nested


def _each(nested: Any, kind: type, convert: Any) -> Any:
    """Replace every value of type `kind` in nested dicts and lists by the result of `convert`."""
    if isinstance(nested, kind):
        return convert(nested)
    if isinstance(nested, dict):
        return {name: _each(value, kind, convert) for name, value in nested.items()}
    return [_each(value, kind, convert) for value in nested] if isinstance(nested, list) else nested
