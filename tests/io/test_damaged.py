"""A flipped byte in a file of ours is found: one error line, or the very same content."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import polars as pl
import pytest
import torch

from hydro.core.errors import DataError
from hydro.io import provenance, sealed, table
from hydro.io.model import SCALERS, Model, from_artefact, to_artefact
from hydro.io.provenance import Input, Provenance
from hydro.io.table import Artefact
from hydro.rl.training.runs import _read_state, _write_state, policy_of

FLIPS = 300
RECORD = Provenance(
    "model", "sha256:1", "sha256:2", "train", {"epochs": 3}, 2**64 - 1, "1", (Input("split", "sha256:3"),)
)


def flipped(content: bytes, seed: int) -> bytes:
    """The content with one byte changed."""
    rng = np.random.default_rng(seed)
    place, by = int(rng.integers(len(content))), int(rng.integers(1, 256))
    return content[:place] + bytes([content[place] ^ by]) + content[place + 1 :]


def trained() -> Artefact:
    """A small model."""
    scalers = {name: np.full(2 if name.startswith("input") else 1, 1.5) for name in SCALERS}
    tensors = {"w": np.arange(6, dtype=np.float32).reshape(2, 3)}
    architecture = {"layers": [2, 3, 1], "activation": "relu"}
    units = {"u": "m/s", "v": "m/s", "X_res": "N"}
    return to_artefact(
        Model("mlp", architecture, tensors, "raw", scalers, ("u", "v"), ("X_res",), units), seed=1
    )


def test_every_flip_in_a_footer_is_found() -> None:
    text = RECORD.to_json()
    assert provenance.from_json(text, "x") == RECORD
    for place in range(len(text)):
        for by in (1, 32, 128):
            broken = text[:place] + bytes([text[place] ^ by]) + text[place + 1 :]
            with pytest.raises(DataError, match="footer"):
                provenance.from_json(broken, "x.parquet")


def test_a_footer_of_an_earlier_version_is_read() -> None:
    assert provenance.from_json(msgspec.json.encode(RECORD), "x") == RECORD


def test_a_flip_in_a_model_is_found_or_changes_nothing(tmp_path: Path) -> None:
    path, model = tmp_path / "model.parquet", trained()
    table.write(model, path)
    content, found = path.read_bytes(), 0
    for seed in range(FLIPS):
        path.write_bytes(flipped(content, seed))
        try:
            read = from_artefact(table.read(path, "model"))
        except DataError:
            found += 1
            continue
        assert {name: each.tolist() for name, each in read.scalers.items()} == {
            name: each.tolist() for name, each in from_artefact(model).scalers.items()
        }
        assert read.tensors["w"].tolist() == from_artefact(model).tensors["w"].tolist()
    assert found > FLIPS / 2


def test_every_flip_in_a_checkpoint_is_found(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.pt"
    state: dict[str, Any] = {"learner": {"w": torch.arange(5.0)}, "steps": 7, "seen": np.arange(3)}
    _write_state(state, path)
    read = _read_state(path)
    assert (read["steps"], read["seen"].tolist()) == (7, [0, 1, 2])
    assert torch.equal(read["learner"]["w"], torch.arange(5.0))
    content = path.read_bytes()
    for seed in range(FLIPS):
        path.write_bytes(flipped(content, seed))
        with pytest.raises(DataError, match=r"checkpoint\.pt: .*: remove it to train again") as error:
            _read_state(path)
        assert "\n" not in str(error.value)
    path.write_bytes(content[:-1])
    with pytest.raises(DataError, match="damaged"):
        _read_state(path)


def test_a_sealed_file_is_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "file"

    def fail() -> None:
        with sealed.writing(path) as stream:
            stream.write(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert list(tmp_path.iterdir()) == []
    with sealed.writing(path) as stream:
        stream.write(b"whole")
    with sealed.reading(path) as stream:
        assert stream.read() == b"whole"
    with pytest.raises(DataError, match="no such file"), sealed.reading(tmp_path / "none"):
        pass


@pytest.mark.parametrize(
    "wrong",
    [
        {"scalers": {}},
        {"scalers": {name: [1.0] for name in SCALERS}},
        {"scalers": {name: [0.0] * (2 if name.startswith("input") else 1) for name in SCALERS}},
        {"scalers": "none"},
        {"inputs": 3},
        {"inputs": [1, 2]},
        {"units": None},
        {"architecture": []},
        {"subtract": "nothing"},
        {"more": 1},
    ],
)
def test_a_footer_that_describes_no_model(wrong: dict[str, Any]) -> None:
    made = trained()
    broken = made.of_network((made.provenance.model or {}) | wrong)
    with pytest.raises(DataError, match=r"^model: .*footer.*: (train it again|write it with)"):
        from_artefact(broken)


@pytest.mark.parametrize("wrong", [{"widths": "wide"}, {"scale": [None]}, {"fades": [0.5]}, {"more": 1}])
def test_a_footer_that_describes_no_policy(wrong: dict[str, Any]) -> None:
    sound = {"widths": [4], "scale": [1.0], "fades": [False], "training": {}}
    frame = pl.DataFrame({"tensor": ["w"], "shape": [[1]], "data": [[1.0]]})
    made = replace(trained(), kind="policy", frame=frame).of_network(sound | wrong)
    with pytest.raises(DataError, match=r"^policy: its footer does not describe one"):
        policy_of(made)
