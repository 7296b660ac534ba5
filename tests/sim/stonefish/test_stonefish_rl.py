"""`hydro rl eval` and `watch` in Stonefish, end to end, with a replacement program that drifts or fails."""

from __future__ import annotations

import time

import msgspec
import numpy as np
import polars as pl
import pytest
from stonefish_cases import ALL, HERE, POSE, VEHICLE, craft
from stonefish_cases import program as script

from hydro import cli
from hydro.core.errors import DataError, UsageError
from hydro.io import table
from hydro.sim.stonefish import program
from hydro.sim.stonefish.plant import StonefishPlant

EVAL = ["rl", "eval", VEHICLE, "--in", "stonefish", "--episodes", 2]


@pytest.fixture
def standing_in(tmp_path, monkeypatch):
    """Replace Stonefish by the drifter."""

    def stand(what):
        monkeypatch.setenv(program.VARIABLE, str(script(tmp_path, HERE / "drifter.py", what)))

    return stand


def run(*words):
    return cli.main([*map(str, words)])


def test_who_only_drifts_reaches_nothing(standing_in, tmp_path):
    standing_in("drifts")
    out, details = tmp_path / "result.parquet", tmp_path / "episodes.parquet"
    assert run(*EVAL, "-o", out, "--details", details) == 0
    artefact = table.read(out, "evaluations")
    assert artefact.frame.select("plant", "flown_by", "success").rows() == [("stonefish", "helmsman", 0.0)]
    assert artefact.provenance.parameters["in"] == "stonefish"
    flown = pl.read_parquet(details)
    assert flown.height == 2
    assert set(flown["outcome"]) == {"time"}


def test_a_drifting_vehicle_is_seen_in_its_tank(standing_in, tmp_path, capsys):
    standing_in("drifts")
    assert run("rl", "watch", VEHICLE, "--in", "stonefish", "-o", tmp_path / "flight.png") == 0
    assert (tmp_path / "flight.png").read_bytes().startswith(b"\x89PNG")
    assert "time after" in capsys.readouterr().err


def test_a_plant_drifts_as_it_began(standing_in):
    standing_in("drifts")
    plant = StonefishPlant(craft(), period=0.04)
    level = np.array([[*POSE[0, :3], np.cos(0.5), 0.0, 0.0, np.sin(0.5)]])
    plant.reset(ALL, level, np.array([[0.5, 0.2, -0.1, 0.0, 0.0, 0.0]]))
    for _ in range(25):
        plant.step(np.full((1, 8), 0.3))
    moved = [np.cos(1.0) * 0.5 - np.sin(1.0) * 0.2, np.sin(1.0) * 0.5 + np.cos(1.0) * 0.2, -0.1]
    np.testing.assert_allclose(plant.pose[0, :3] - level[0, :3], moved, atol=1e-9)
    np.testing.assert_allclose(plant.thrust, 0.3 * 155.0)


@pytest.mark.parametrize(
    ("what", "told"),
    [
        ("dies", "ended without an answer (exit code 1): a thruster came off"),
        ("hangs", "gave no answer for 0.5 s and was ended"),
        ("silent", "gave no answer for 0.5 s and was ended"),
        ("another", "speaks version 2 of its protocol, and this hydro version 1: build bridge/stonefish"),
    ],
)
@pytest.mark.parametrize("line", [EVAL, ["rl", "watch", VEHICLE, "--in", "stonefish"]], ids=["eval", "watch"])
def test_a_program_that_fails_is_told_in_one_line(
    line, what, told, standing_in, tmp_path, monkeypatch, capsys
):
    standing_in(what)
    if what in ("hangs", "silent"):
        monkeypatch.setattr(program, "PATIENCE", 0.5)
    begun = time.monotonic()
    assert run(*line, "-o", tmp_path / "flown.png") == DataError.exit_code
    assert time.monotonic() - begun < 60.0, "it waits for a program that sleeps ten minutes"
    said = capsys.readouterr().err.strip()
    assert "\n" not in said
    assert told in said
    assert not (tmp_path / "flown.png").exists()


def test_a_recording_is_given_up_as_well(standing_in, tmp_path, monkeypatch, capsys):
    standing_in("hangs")
    monkeypatch.setattr(program, "PATIENCE", 0.5)
    line = ["collect", "--vehicle", VEHICLE, "--teacher", "stonefish", "--rows", 100]
    assert run(*line, "-o", tmp_path / "raw.parquet") == DataError.exit_code
    assert "gave no answer for 0.5 s" in capsys.readouterr().err


def test_a_missing_program_is_told_with_what_to_build(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(program.VARIABLE, str(tmp_path / "none"))
    assert run(*EVAL, "-o", tmp_path / "result.parquet") == UsageError.exit_code
    said = capsys.readouterr().err.strip()
    assert "\n" not in said
    assert "bridge/stonefish" in said


def test_more_vehicles_than_processes_are_refused(tmp_path, capsys):
    assert run(*EVAL[:-1], 300, "-o", tmp_path / "result.parquet") == UsageError.exit_code
    assert "256 at most" in capsys.readouterr().err


def test_a_vehicle_with_other_thrusters_does_not_fly_beside():
    plant, known = StonefishPlant(craft()), craft()
    with pytest.raises(DataError, match="other thrusters or internal states"):
        plant.change({0: msgspec.structs.replace(known, thruster=known.thruster[:6])})
