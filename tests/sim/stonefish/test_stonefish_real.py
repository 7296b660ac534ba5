"""Stonefish itself: does it do again what it did when the bundled data were recorded?

With HYDRO_STONEFISH_RECORD=1 the exchanges that the other tests play are written anew.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from stonefish_cases import HERE, VEHICLE, WALK, flown_twice, program, replayed

from hydro import cli
from hydro.io import table
from hydro.sim.stonefish.program import NAME, VARIABLE

PROGRAM = shutil.which(os.environ.get(VARIABLE, NAME))
RECORD = bool(os.environ.get("HYDRO_STONEFISH_RECORD"))
pytestmark = [
    pytest.mark.stonefish,
    pytest.mark.skipif(PROGRAM is None, reason=f"{NAME} is not installed (docs/stonefish.md)"),
]


@pytest.fixture(autouse=True)
def recorded(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep what is said in tests of an exchange, where it is asked for."""
    of = {"flight": "bundled_replay", "plant": "goes_back", "walk": "session"}
    names = [name for name, part in of.items() if part in request.node.name]
    if RECORD and names:
        path = program(tmp_path, HERE / "exchange.py", HERE / f"{names[0]}.txt", PROGRAM)
        monkeypatch.setenv(VARIABLE, str(path))


def test_the_bundled_replay_is_flown_again():
    wanted, motion = replayed(60 if RECORD else 4500)
    assert np.abs(motion[:, 6:] - wanted[:, 6:]).max() < 0.01
    assert np.abs(motion[:, :3] - wanted[:, :3]).max() < 0.05


def test_a_plant_goes_back_bit_for_bit():
    _, first, again = flown_twice()
    np.testing.assert_array_equal(first, again)


def test_a_session_is_recorded(tmp_path):
    assert cli.main([*map(str, WALK), "-o", str(tmp_path / "raw.parquet")]) == 0
    assert table.read(tmp_path / "raw.parquet").frame.height == 100


def test_a_pilot_by_hand_reaches_his_goals(tmp_path):
    out = tmp_path / "result.parquet"
    line = ["rl", "eval", VEHICLE, "--in", "stonefish", "--episodes", 2, "-o", out]
    assert cli.main(list(map(str, line))) == 0
    result = table.read(out, "evaluations").frame
    assert result.select("plant", "success").rows() == [("stonefish", 1.0)]
