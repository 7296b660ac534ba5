"""ONNX export of networks and policies by the command."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from sim.trained import trained

from hydro.cli import main
from hydro.core.distillation.features import OUTPUTS
from hydro.export.onnx_network import to_onnx
from hydro.io import table
from hydro.io.model import Model, to_artefact
from hydro.learn import networks
from hydro.rl.environment.observation import ENCODING, NAMES
from hydro.rl.training.policy import Policy, network

onnxruntime = pytest.importorskip("onnxruntime", reason="the extra onnx is not installed")


@pytest.fixture(scope="module")
def policy():
    torch.manual_seed(0)
    tensors = network(len(ENCODING), 6, (32, 24)).state_dict()
    return Policy((32, 24), ENCODING, {name: each.numpy() for name, each in tensors.items()})


def test_onnxruntime_says_what_a_policy_says(policy):
    session = onnxruntime.InferenceSession(to_onnx(policy))
    rng = np.random.default_rng(0)
    for count in (1, 7):
        seen = rng.normal(scale=5.0, size=(count, len(ENCODING))).astype(np.float32)
        (said,) = session.run(["actions"], {"observations": seen})
        np.testing.assert_allclose(said, policy(seen.copy()), rtol=1e-5, atol=1e-5)
    described = session.get_modelmeta().custom_metadata_map
    assert described["observations"].split() == list(NAMES)


def test_the_command_writes_a_network(tmp_path, capfd):
    _, drawn = trained("mlp")
    features = drawn.architecture["features"]
    model = Model(
        **vars(drawn),
        features=features,
        inputs=networks.inputs(drawn.architecture),
        outputs=OUTPUTS,
        units={},
    )
    source, out = tmp_path / "model.parquet", tmp_path / "model.onnx"
    table.write(to_artefact(model), source)
    assert main(["export", str(source), "-o", str(out)]) == 0, capfd.readouterr().err
    assert out.read_bytes() == to_onnx(model)
    assert main(["export", str(source), "--on", str(source), "-o", str(out)]) == 2
    assert "nothing is left out of a network" in capfd.readouterr().err
    assert main(["export", str(source), "--to", "gz", "-o", str(out)]) == 2
    assert "takes a vehicle file (.toml)" in capfd.readouterr().err
