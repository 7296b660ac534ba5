"""Export of residual models as ONNX for programs without torch: from states to newtons.

The graph contains features, scalers and units: its input (nu, nu_dot) is that of a recording.  A model with a
window takes past velocities as a second input, which the caller keeps (`distillation.history`).
"""

from __future__ import annotations

import contextlib
import importlib.util
import logging
import os
import warnings
from collections.abc import Iterator, Mapping

import torch
from torch import Tensor, nn

from hydro.core.distillation.features import CROSS
from hydro.core.distillation.history import memory_size
from hydro.core.errors import UsageError
from hydro.io.model import Model
from hydro.learn.networks import load

OPSET = 18  # version of the ONNX operators
NEEDED = ("onnx", "onnxscript")  # libraries of the extra `onnx`


class Exported(nn.Module):
    """Torch module of a complete residual model: from states in SI units to the wrench."""

    def __init__(self, model: Model) -> None:
        super().__init__()
        self.network = load(model)
        self.physfeat = model.features == "physfeat"

    def forward(self, states: Tensor, past: Tensor | None = None) -> Tensor:
        """Return tau_res (N, 6) [N, N m], body FRD, for states and past velocities.

        Args:
            states: (nu, nu_dot) in body axes FRD, (N, 12) [m/s, rad/s, m/s^2, rad/s^2].
            past: past velocities (N, 6 (window - 1)) of a model with a window, newest first; None otherwise.
        """
        inputs = physfeat(states) if self.physfeat else states
        if past is not None:
            inputs = torch.cat([inputs, past], dim=1)
        wrench: Tensor = self.network(inputs)
        return wrench


def physfeat(states: Tensor) -> Tensor:
    """Return the features `physfeat` (N, 45) of states (nu, nu_dot) (N, 12), as torch tensors."""
    nu = states[:, :6]
    first, second = torch.triu_indices(6, 6, offset=1).unbind()
    even, odd = torch.from_numpy(CROSS.T.copy()).unbind()
    return torch.cat(
        [states, nu * nu.abs(), nu[:, first] * nu[:, second], nu[:, even].abs() * nu[:, odd]], dim=1
    )


def to_onnx(model: Model) -> bytes:
    """Return a residual model as the bytes of an ONNX file.

    Inputs: `states` (N, 12), nu and nu_dot [m/s, rad/s, m/s^2, rad/s^2], body FRD.  A model with a window
    also has `past` (N, 6 (window - 1)), the velocities of the previous control steps, newest first. Output:
    `tau_res` (N, 6) [N, N m], on the left-hand side of the equations of motion: the wrench on the vehicle is
    -tau_res.  All are float32.  The metadata of the file repeat these definitions.

    Raises:
        DataError: If the tensors of the model do not fit its architecture.
        UsageError: If the libraries are not installed.
    """
    window = model.architecture.get("window", 1)
    arguments = [torch.zeros(2, 12)] + ([torch.zeros(2, memory_size(window))] if window > 1 else [])
    described = {
        "model": model.name,
        "states": "u v w p q r [m/s, rad/s], then their rates; body FRD",
        "tau_res": "X Y Z K M N [N, N m]; body FRD, left-hand side: the vehicle feels -tau_res",
        "subtract": model.subtract,
    }
    if window > 1:
        described["past"] = f"u v w p q r at {window - 1} steps before, newest first"
        described["period"] = f"{model.architecture['period']:g} s"
    names = ["states", "past"][: len(arguments)]
    return graph(Exported(model), dict(zip(names, arguments, strict=True)), "tau_res", described)


def graph(
    module: nn.Module, inputs: Mapping[str, Tensor], output: str, described: Mapping[str, str]
) -> bytes:
    """Return a torch module as the bytes of an ONNX file.

    Args:
        module: Module to export.
        inputs: Example inputs by name, two rows each; the graph accepts any number of rows.
        output: Name of the output.
        described: Metadata of the file.

    Raises:
        UsageError: If the libraries are not installed.
    """
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise UsageError(
            f"{missing[0]} is not installed: install hydro's extra `onnx`: pip install 'deep-hydro-sim[onnx]'"
        )
    with _quiet():
        program = torch.onnx.export(
            module,
            tuple(inputs.values()),
            input_names=list(inputs),
            output_names=[output],
            opset_version=OPSET,
            dynamo=True,
            external_data=False,
            dynamic_shapes=tuple({0: torch.export.Dim("rows")} for _ in inputs),
        )
    assert program is not None
    proto = program.model_proto
    for key, value in described.items():
        proto.metadata_props.add(key=key, value=value)
    data: bytes = proto.SerializeToString(deterministic=True)
    return data


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Suppress the exporter's progress and advice."""
    level = logging.getLogger("torch.onnx").level
    with (
        warnings.catch_warnings(),
        open(os.devnull, "w") as nowhere,
        contextlib.redirect_stdout(nowhere),
        contextlib.redirect_stderr(nowhere),
    ):
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        try:
            yield
        finally:
            logging.getLogger("torch.onnx").setLevel(level)
