"""Exported networks: same output as the torch model, without torch."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from sim.trained import trained

from hydro.core.distillation.features import OUTPUTS
from hydro.core.errors import UsageError
from hydro.io.model import Model
from hydro.learn import export, networks
from hydro.learn.evaluate import predict
from hydro.learn.networks import ARCHITECTURES

onnxruntime = pytest.importorskip("onnxruntime", reason="the extra onnx is not installed")


def artefact(name: str) -> Model:
    _, drawn = trained(name)
    return Model(
        **vars(drawn),
        features=drawn.architecture["features"],
        inputs=networks.inputs(drawn.architecture),
        outputs=OUTPUTS,
        units={},
    )


@cache
def exported(name: str) -> bytes:
    """ONNX file of a network, made once: an export takes seconds."""
    return export.to_onnx(artefact(name))


@pytest.mark.parametrize("name", list(ARCHITECTURES))
def test_onnxruntime_says_what_torch_says(name):
    model = artefact(name)
    session = onnxruntime.InferenceSession(exported(name))
    rng = np.random.default_rng(0)
    for count in (1, 7):
        states = rng.normal(size=(count, 12)).astype(np.float32)
        given, past = {"states": states}, None
        if name == "temporal":
            past = rng.normal(size=(count, 42)).astype(np.float32)
            given["past"] = past
        expected = predict(model, states, past)
        (said,) = session.run(["tau_res"], given)
        np.testing.assert_allclose(said, expected, rtol=1e-5, atol=1e-5 * abs(expected).max())
    described = session.get_modelmeta().custom_metadata_map
    assert described["model"] == name
    assert "left-hand side" in described["tau_res"]
    assert described.get("period") == ("0.04 s" if name == "temporal" else None)


def test_the_same_model_gives_the_same_bytes():
    assert export.to_onnx(artefact("mlp")) == exported("mlp")


def test_without_the_extra_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr(export, "NEEDED", ("no_such_library",))
    with pytest.raises(UsageError, match="install hydro's extra `onnx`"):
        export.to_onnx(artefact("mlp"))
