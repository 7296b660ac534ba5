"""`hydro simulate` and `hydro effects`: runs, pipes, wrong input, and what the catalogue tells."""

from __future__ import annotations

import contextlib
import io
import json
import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from streams_here import piped

from hydro import cli
from hydro.core.columns import POSE, VELOCITY
from hydro.core.effects import CATALOGUE
from hydro.core.simulation.estimates import Estimate, Estimates
from hydro.core.simulation.simulate import simulate as move
from hydro.io import covariance, table
from hydro.io import vehicle as vehicles
from hydro.io.model import from_artefact

ROOT = Path(__file__).resolve().parents[1]
VEHICLE = ROOT / "datasets" / "vehicles" / "auv151.toml"


def run(*arguments: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command in this process."""
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        code = cli.main([str(argument) for argument in arguments])
    return code, out.getvalue(), error.getvalue()


def commands(rows: int = 150, thrusters: int = 8) -> pl.DataFrame:
    """Two sessions: all thrusters ahead and down a little, then still."""
    held = np.full((rows, thrusters), 0.2)
    columns = {f"cmd_{i + 1}": np.concatenate([held[:, i], 0.0 * held[:, i]]) for i in range(thrusters)}
    t = np.tile(np.arange(rows) * 0.02, 2)
    return pl.DataFrame({"session": ["pushed"] * rows + ["left"] * rows, "t": t, **columns})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with commands, plain and as an artefact, and what they do."""
    made = tmp_path_factory.mktemp("simulate")
    commands().write_parquet(made / "plain.parquet")
    table.write(table.make("commands", commands(), stage="design"), made / "commands.parquet")
    assert run("simulate", VEHICLE, made / "commands.parquet", "-o", made / "raw.parquet") == (0, "", "")
    return made


# simulate


def test_bands_come_from_the_covariance_beside_the_file(folder, tmp_path):
    """One wide parameter: a band in surge about what the vehicle does; none without a covariance."""
    mine, made = tmp_path / "mine.toml", tmp_path / "bands.parquet"
    mine.write_text(VEHICLE.read_text())
    short = tmp_path / "short.parquet"
    commands(rows=30).write_parquet(short)
    code, _, error = run("simulate", mine, short, "--bands", "-o", made)
    assert code != 0
    assert "mine.covariance.parquet: no such file; bands need the covariance" in error
    known, text = vehicles.read(mine)
    drag = Estimate("linear_damping", "diagonal", (2,), "N s/m", 60.0)
    covariance.write(Estimates((drag,), np.array([[400.0]])), mine, stage="fit", inputs=(), vehicle_text=text)
    assert run("simulate", mine, short, "--bands", "--draws", "40", "-o", made) == (0, "", "")
    found = table.read(made, "bands")
    assert found.provenance.seed == 0
    assert {one.kind for one in found.provenance.inputs} == {"commands", "covariance", "vehicle"}
    moved = move(known, commands(rows=30))
    np.testing.assert_allclose(found.frame["w"], moved["w"])
    width = (found.frame["w_high"] - found.frame["w_low"]).to_numpy()
    assert width[29] > 1e-4
    assert (found.frame["w_low"][1:30] < moved["w"][1:30]).all()


def test_what_is_simulated_is_raw_data_with_its_vehicle(folder):
    artefact = table.read(folder / "raw.parquet", "raw")
    known, text = vehicles.read(VEHICLE)
    assert artefact.frame.equals(move(known, commands()).select(artefact.frame.columns))
    made = artefact.provenance
    assert (made.stage, made.vehicle) == ("simulate", text)
    assert [one.kind for one in made.inputs] == ["commands", "vehicle"]
    assert run("labels", folder / "raw.parquet", "-o", folder / "labels.parquet") == (0, "", "")


def test_a_session_of_commands_starts_at_rest_at_the_origin(folder):
    frame = table.read(folder / "raw.parquet").frame
    first = frame.group_by("session").first().select(*POSE, *VELOCITY).to_numpy()
    np.testing.assert_array_equal(first, 0.0)
    pushed = frame.filter(session="pushed")
    assert pushed["w"].to_numpy()[-1] > 0.1  # the vertical thrusters push down


def test_a_table_of_commands_needs_no_footer_and_a_pipe_gives_the_bytes_of_the_file(folder):
    assert run("simulate", VEHICLE, folder / "plain.parquet", "-o", folder / "other.parquet")[0] == 0
    assert table.read(folder / "other.parquet").frame.equals(table.read(folder / "raw.parquet").frame)
    done = piped("simulate", VEHICLE, stdin=(folder / "commands.parquet").read_bytes())
    assert done == (0, (folder / "raw.parquet").read_bytes(), b"")


def test_a_raw_table_gives_the_initial_state_and_simulating_again_changes_nothing(folder):
    """Cut in the middle of a session: without lag left over, the rest of it goes the same way."""
    whole = table.read(folder / "raw.parquet").frame
    rest = whole.filter(session="left")[60:]
    rest.write_parquet(folder / "rest.parquet")
    assert run("simulate", VEHICLE, folder / "rest.parquet", "-o", folder / "again.parquet")[0] == 0
    again = table.read(folder / "again.parquet").frame
    np.testing.assert_allclose(again.select(*POSE, *VELOCITY), rest.select(*POSE, *VELOCITY), atol=1e-9)


BAD = {
    "seven": (commands(thrusters=7), "7 command columns, no cmd_8"),
    "nine": (commands(thrusters=9), "9 command columns, also cmd_9"),
    "full": (commands().with_columns(cmd_3=pl.lit(1.5)), "cmd_3.*at most 1"),
    "gap": (commands().filter((pl.col("t") < 1.0) | (pl.col("t") > 2.0)), "a gap in t before row 50"),
    "backwards": (commands().reverse(), "increasing|rise"),
    "nothing": (commands().clear(), "no rows"),
    "half": (commands().with_columns(u=pl.lit(0.0)), "column u is not part of a commands table"),
}


@pytest.mark.parametrize("name", BAD)
def test_commands_at_fault_are_told_in_one_line(name, tmp_path):
    frame, message = BAD[name]
    frame.write_parquet(tmp_path / f"{name}.parquet")
    code, out, error = run("simulate", VEHICLE, tmp_path / f"{name}.parquet", "-o", tmp_path / "out.parquet")
    assert (code, out) == (1, "")
    assert re.fullmatch(rf"hydro: .*{name}\.parquet: .+\n", error), error
    assert re.search(message, error), error
    assert not (tmp_path / "out.parquet").exists()


def test_a_vehicle_at_fault_is_told_in_one_line(folder, tmp_path):
    for text, message in (
        (VEHICLE.read_text().replace("mass = 151.0", "mass = 0.0"), "rigid_body.mass"),
        (VEHICLE.read_text() + '\n[[effect]]\nname = "warp_drive"\n', r"effect\[3\].name"),
    ):
        (tmp_path / "odd.toml").write_text(text)
        code, out, error = run(
            "simulate", tmp_path / "odd.toml", folder / "raw.parquet", "-o", tmp_path / "x"
        )
        assert (code, out) == (1, "")
        assert re.fullmatch(rf"hydro: .*odd\.toml: {message}.+\n", error), error
    assert run("simulate", tmp_path / "absent.toml", folder / "raw.parquet", "-o", "x")[0] == 1


# labels --subtract effects, and what follows from it


def test_a_model_of_what_the_effects_leave_flies_with_them(tmp_path):
    t = np.arange(1500) * 0.02
    held = {f"cmd_{i + 1}": 0.4 * np.sin((0.5 + 0.1 * i) * t + i) for i in range(8)}
    files = {
        name: tmp_path / f"{name}.parquet" for name in ("cmd", "raw", "labels", "model", "errors", "flown")
    }
    begun = {name: [10.0 if name == "z" else 0.0] * 1500 for name in (*POSE, *VELOCITY)}
    pl.DataFrame({"session": ["weave"] * 1500, "t": t, **begun, **held}).write_parquet(files["cmd"])
    for line in (
        ["simulate", VEHICLE, files["cmd"], "-o", files["raw"]],
        ["labels", files["raw"], "--subtract", "effects", "-o", files["labels"]],
        ["train", files["labels"], "--model", "mlp", "--epochs", 1, "-o", files["model"]],
        [
            "replay",
            files["raw"],
            "--model",
            files["model"],
            "--metrics",
            files["errors"],
            "-o",
            files["flown"],
        ],
    ):
        assert run(*line) == (0, "", "")
    made = table.read(files["labels"]).provenance.parameters
    assert made["subtract"] == "effects"
    assert made["subtracted"] == ["added_mass", "linear_damping", "quadratic_damping"]
    assert from_artefact(table.read(files["model"])).subtract == "effects"
    flown = table.read(files["flown"]).provenance.parameters["variants"]
    assert flown == ["MJ0", "MJ0+M_A", "MJ0+ellipsoid", "effects", "effects+MJ1"]
    errors = table.read(files["errors"]).frame.filter(metric="rmse", axis="u")
    rmse = dict(errors.select("variant", "value").iter_rows())
    assert rmse["effects"] < 0.01 < rmse["MJ0"]

    (tmp_path / "other.toml").write_text(VEHICLE.read_text().replace("95.0, 260.0", "90.0, 260.0"))
    other = ("--vehicle", tmp_path / "other.toml")
    code, out, error = run("replay", files["raw"], "--model", files["model"], *other, "-o", tmp_path / "x")
    assert (code, out) == (1, "")
    assert re.fullmatch(
        r"hydro: .*model.parquet: the effects of another vehicle file were subtracted from its labels: .*\n",
        error,
    )


# effects


def test_the_catalogue_goes_through_a_pipe_as_json():
    code, out, error = run("effects")
    assert (code, error) == (0, "")
    assert [one["name"] for one in json.loads(out)] == list(CATALOGUE)


def test_every_effect_by_name_is_told_in_full():
    for name, effect in CATALOGUE.items():
        code, out, error = run("effects", name)
        assert (code, error) == (0, ""), name
        told = json.loads(out)
        assert (told["kind"], told["family"], told["source"]) == (effect.kind, effect.family, effect.source)
        assert told["lookalikes"] == list(effect.lookalikes), name
        assert [one["name"] for one in told["parameters"]] == [one.name for one in effect.parameters], name
        assert tomllib.loads(told["toml"])["effect"][0]["name"] == name


def test_a_misspelt_effect_gets_a_suggestion():
    code, out, error = run("effects", "linear_dampin")
    assert (code, out) == (2, "")
    assert error == "hydro: no effect is called 'linear_dampin': did you mean linear_damping?\n"
    assert "lists all" in run("effects", "xyzzy")[2]


def test_on_a_terminal_the_catalogue_is_a_table_with_whole_names(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    for arguments, expected in (
        ([], list(CATALOGUE)),
        (["fluid_memory"], ["rates", "1/s", "Cummins", "[[effect]]"]),
    ):
        screen = Terminal()
        monkeypatch.setenv("COLUMNS", "100")
        monkeypatch.setattr(sys, "stdout", screen)
        assert cli.main(["effects", *arguments]) == 0
        assert all(name in screen.getvalue() for name in expected)
        assert not screen.getvalue().startswith(("{", "["))


# fit


def test_noise_is_given_as_to_collect_and_few_shots_are_told(folder, tmp_path):
    """150 rows of two sessions hold two shots; noise a hundred times too great gives so much less chi2."""
    found = []
    for noise in ("{velocity=0.01, rate=0.002, position=0.02, attitude=0.001}", "dvl"):
        path = tmp_path / "fitted.toml"
        code, _, error = run(
            "fit", VEHICLE, folder / "raw.parquet", "--effect", "net_buoyancy", "--noise", noise, "-o", path
        )
        assert code == 0, error
        found.append(vehicles.read(path)[0].effects("net_buoyancy")[0]["fit"]["chi2"])
    assert 0.0 <= found[1] <= found[0]
    code, _, error = run(
        "fit", VEHICLE, folder / "raw.parquet", "--effect", "net_buoyancy", "--noise", "loud"
    )
    assert code == 2
    assert error.startswith("hydro: --noise 'loud': neither a profile")
