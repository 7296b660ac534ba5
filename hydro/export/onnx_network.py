"""Target `onnx`: a residual network or a policy as an ONNX graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hydro.export.targets import Target
from hydro.io.model import Model

if TYPE_CHECKING:
    from hydro.rl.training.policy import Policy


def to_onnx(trained: Model | Policy) -> bytes:
    """Return a residual network (`learn.export`) or a policy as the bytes of an ONNX file.

    Raises:
        DataError: The tensors of a network do not fit its architecture.
        UsageError: The libraries are not installed.
    """
    from hydro.learn.export import to_onnx as write

    return write(trained) if isinstance(trained, Model) else of_policy(trained)


def of_policy(policy: Policy) -> bytes:
    """Return a policy as the bytes of an ONNX file: `observations` (N, O) in SI units to `actions` (N, A).

    All are float32.  A policy with stacked observations takes the steps in one row, the newest first.
    """
    import torch

    from hydro.learn.export import graph
    from hydro.rl.environment.observation import NAMES
    from hydro.rl.training.policy import EncodedPolicy

    count = len(policy.encoding)
    described = {"actions": "shares of the authority on each axis, in [-1, 1]"}
    seen = count // len(NAMES)
    described["observations"] = " ".join(NAMES) if seen == 1 else f"{seen} x {' '.join(NAMES)}, newest first"
    return graph(EncodedPolicy(policy).eval(), {"observations": torch.zeros(2, count)}, "actions", described)


TARGET = Target(
    name="onnx",
    takes="model",
    suffix=".onnx",
    summary="a residual network or a policy as an ONNX graph",
    write=to_onnx,
    text=False,
)
