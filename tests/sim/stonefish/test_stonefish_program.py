"""Protocol of hydro-stonefish, compared with a recorded exchange, and all failures of the program."""

from __future__ import annotations

import numpy as np
import pytest
from stonefish_cases import HERE, WALK, craft, flown_twice, program, replayed

from hydro import cli
from hydro.core.errors import DataError, UsageError
from hydro.io import table
from hydro.sim.stonefish.program import VARIABLE, Program
from hydro.sim.stonefish.recorder import stonefish_teacher

HELLO = "hydro-stonefish 1 1.6.0 500 8"


@pytest.fixture
def playing(tmp_path, monkeypatch):
    """Replace Stonefish by the replay of an exchange."""

    def play(name):
        path = program(tmp_path, HERE / "exchange.py", HERE / f"{name}.txt")
        monkeypatch.setenv(VARIABLE, str(path))

    return play


def test_the_recorded_flight_is_the_bundled_replay(playing):
    playing("flight")
    wanted, motion = replayed(60)
    assert np.abs(motion[:, 6:] - wanted[:, 6:]).max() < 0.01
    with pytest.raises(DataError, match="ended without an answer"):
        replayed(61)


def test_a_plant_asks_for_the_same_again(playing):
    playing("plant")
    plant, first, again = flown_twice()
    np.testing.assert_array_equal(first, again)
    assert not plant.diverged.any()


def test_a_session_is_raw_data_that_names_its_teacher(playing, tmp_path):
    playing("walk")
    out, truth = tmp_path / "raw.parquet", tmp_path / "truth.toml"
    assert cli.main([*map(str, WALK), "--truth", str(truth), "-o", str(out)]) == 0
    artefact = table.read(out)
    parameters = artefact.provenance.parameters
    assert (parameters["teacher"], parameters["stonefish"]) == ("stonefish", "1.6.0")
    assert artefact.frame.height == 100
    assert "[stonefish]" in truth.read_text()


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (["something else"], "names another"),
        (["hydro-stonefish 2 1.6.0 500 8"], "version 2 of its protocol"),
        (["hydro-stonefish 1 1.3.0 500 8"], "1.4 or later"),
        (["hydro-stonefish 1 1.6.0 500 6"], "6 thrusters"),
        ([HELLO, "row 1 2"], "in the place of a row"),
        ([HELLO, "row " + "x " * 24], "in the place of a row"),
        ([HELLO, "error no ocean"], "hydro-stonefish: no ocean"),
        ([HELLO], "ended without an answer"),
    ],
)
def test_what_is_no_answer_is_told_in_one_line(tmp_path, said, told):
    (tmp_path / "bad.txt").write_text("".join(f"< {line}\n" for line in said))
    path = program(tmp_path, HERE / "exchange.py", tmp_path / "bad.txt")
    with Program(stonefish_teacher(craft()).scenario, str(path)) as asked:
        asked.reset(np.zeros(13))
        with pytest.raises(DataError, match=told) as error:
            asked.answer()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("named", ["", "/no/such/program"])
def test_a_missing_program_is_told_with_what_to_build(named, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(VARIABLE, named)
    if not named:
        monkeypatch.setenv("PATH", str(tmp_path))
    assert cli.main([*map(str, WALK), "-o", str(tmp_path / "raw.parquet")]) == UsageError.exit_code
    said = " ".join(capsys.readouterr().err.split())
    assert "bridge/stonefish" in said
    assert VARIABLE in said
