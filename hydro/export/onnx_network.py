"""Target `onnx`: a residual network as an ONNX graph."""

from __future__ import annotations

from hydro.export.targets import Target
from hydro.io.model import Model


def to_onnx(model: Model) -> bytes:
    """The graph of a network (`learn.export`)."""
    from hydro.learn.export import to_onnx as write

    return write(model)


TARGET = Target(
    name="onnx",
    takes="model",
    suffix=".onnx",
    summary="a residual network as an ONNX graph: states in, the wrench out",
    write=to_onnx,
    text=False,
)
