"""`hydro vehicle new`: by options and by answers, the file it writes, bad input in one line."""

from __future__ import annotations

import os
import pty
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from hydro import cli
from hydro.core.geometry import solid
from hydro.core.identification.prior import stated
from hydro.core.prediction.parameters import free
from hydro.core.simulation.simulate import simulate
from hydro.io import vehicle

ROOT = Path(__file__).resolve().parents[1]
ROV = ["--mass", "11.5", "--length", "0.46", "--width", "0.34", "--height", "0.25"]
THRUSTERS = ["--layout", "vectored6", "--thrust", "40"]
EXAMPLE = next(
    line for family in cli.FAMILIES if family.NAME == "vehicle" for line in family.COMMANDS.values()
)


def new(*arguments: object) -> int:
    return cli.main(["vehicle", "new", *map(str, arguments)])


@pytest.fixture(autouse=True)
def off_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", open(os.devnull))  # noqa: SIM115


def test_the_example_of_the_help_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(shlex.split(EXAMPLE)[1:]) == 0
    assert cli.main(["check", "rov.toml"]) == 0


@pytest.mark.parametrize("shape", ["torpedo", "ellipsoid", "box"])
@pytest.mark.parametrize("layout", ["single", "tunnel5", "vectored6", "vectored8"])
def test_a_new_vehicle_file_passes_check_and_simulates(shape: str, layout: str, tmp_path: Path) -> None:
    file = tmp_path / "a b.toml"
    line = [*ROV, "--shape", shape, "--layout", layout, "--thrust", 40, "--name", 'my "ROV" ü', "-o", file]
    assert new(*line) == 0
    known, text = vehicle.read(file)
    assert known.name == 'my "ROV" ü'
    assert max(map(len, text.splitlines())) <= 140
    commands = {f"cmd_{i + 1}": 0.3 for i in range(len(known.thruster))}
    course = pl.DataFrame({"session": ["s"] * 50, "t": np.arange(50) * 0.02}).with_columns(
        **{name: pl.lit(value) for name, value in commands.items()}
    )
    moved = simulate(known, course)
    assert moved["u"][-1] > 0.0
    assert np.isfinite(moved.select(pl.col("u", "v", "w", "p", "q", "r")).to_numpy()).all()


def test_every_value_of_a_new_file_has_a_standard_error(tmp_path: Path) -> None:
    """What fit and diagnose take from the file: a finite standard deviation of each entry."""
    assert new(*ROV, *THRUSTERS, "--shape", "torpedo", "-o", tmp_path / "v.toml") == 0
    known, _ = vehicle.read(tmp_path / "v.toml")
    entries = free(known, [table["name"] for table in known.effect]).entries
    errors = stated(known, entries)
    assert np.isfinite(errors).sum() == 6 + 2 + 8 + 6 + 6
    assert np.all(errors > 0.0)
    left_out = {entry.name for entry, error in zip(entries, errors, strict=True) if error == np.inf}
    assert left_out == {f"added_mass_coupling.{name}" for name in ("M04", "M13", "M02")}


def test_the_file_goes_to_standard_output_without_output_option(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert new(*ROV, *THRUSTERS) == 0
    text = capsys.readouterr().out
    assert vehicle.parse(text).name == "vehicle"
    assert new(*ROV, *THRUSTERS, "--name", "vehicle", "-o", tmp_path / "v.toml") == 0
    assert (tmp_path / "v.toml").read_text() == text


def test_options_of_vehicle_new_are_in_the_file(tmp_path: Path) -> None:
    file = tmp_path / "v.toml"
    thrusters = ["--thruster", "-0.2,0,0,1,0,0,40", "--thruster=0,0,0,0,0,2,20,15"]
    more = [
        "--buoyancy",
        114,
        "--metacentric-height",
        0.03,
        "--water-density",
        1000,
        "--inertia",
        "0.1,0.2,0.2",
    ]
    assert new(*ROV, *thrusters, *more, "--curve", "quadratic", "--time-constant", 0.2, "-o", file) == 0
    known, text = vehicle.read(file)
    assert known.buoyancy.force == 114.0
    assert known.rigid_body.center_of_gravity == (0.0, 0.0, 0.03)
    assert known.environment.water_density == 1000.0
    assert known.thruster[1].direction == (0.0, 0.0, 1.0)
    assert {(each.curve, each.time_constant) for each in known.thruster} == {("quadratic", 0.2)}
    assert [each.max_reverse_thrust for each in known.thruster] == [40.0, 15.0]
    assert "DNV-RP-C205" in text
    assert known.name == "v"


def test_an_existing_file_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "v.toml"
    file.write_text("mine")
    assert new(*ROV, *THRUSTERS, "-o", file) == 2
    assert "--force" in capsys.readouterr().err
    assert file.read_text() == "mine"
    assert new(*ROV, *THRUSTERS, "--force", "-o", file) == 0
    vehicle.read(file)


def box_mesh(path: Path, faces: int = 12) -> Path:
    """A closed box of 0.46 x 0.34 x 0.25 m."""
    corners = [(x, y, z) for x in (-0.23, 0.23) for y in (-0.17, 0.17) for z in (-0.125, 0.125)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["f " + " ".join(str(i + 1) for i in quad) for quad in quads]
    path.write_text("\n".join(lines[: 8 + faces]))
    return path


@pytest.mark.parametrize("installed", [True, False])
def test_a_mesh_gives_the_size_of_the_hull(
    installed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if installed:
        pytest.importorskip("capytaine", reason="capytaine is not installed")
    else:
        monkeypatch.setattr(solid, "solvable", lambda: False)
    (tmp_path / "files").mkdir()
    mesh = box_mesh(tmp_path / "hull.obj")
    file = tmp_path / "files" / "v.toml"
    assert new("--mass", 11.5, "--mesh", mesh, *THRUSTERS, "-o", file) == 0
    assert ("equivalent ellipsoid" in capsys.readouterr().err) is not installed
    known, _ = vehicle.read(file)
    assert (file.parent / known.hull.mesh).resolve() == mesh, "beside the vehicle file"
    assert (known.hull.length, known.hull.width, known.hull.height) == (0.46, 0.34, 0.25)
    assert cli.main(["check", str(file)]) == 0


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([], 2, "missing: --mass, --length, --width, --height, --thruster (or --layout with --thrust)"),
        ([*ROV, "--layout", "single"], 2, "missing: --thrust "),
        ([*ROV, *THRUSTERS, "--thruster", "0,0,0,1,0,0,4"], 2, "--thruster and --layout"),
        (["--mass", "0", *ROV[2:], *THRUSTERS], 1, "mass: must be a positive"),
        (["--mass", "heavy", *ROV[2:], *THRUSTERS], 2, "--mass"),
        ([*ROV[:4], "--width", "-0.3", *ROV[6:], *THRUSTERS], 1, "positive, finite length, width and height"),
        ([*ROV[:4], "--width", "nan", *ROV[6:], *THRUSTERS], 1, "positive, finite length, width and height"),
        ([*ROV, "--thruster", "0,0,0,1,0,40"], 1, "x,y,z,dx,dy,dz,max"),
        ([*ROV, "--layout", "single", "--thrust", "-4"], 1, "greatest thrust must be above 0 N"),
        ([*ROV, "--layout", "octopus", "--thrust", "4"], 2, "--layout"),
        ([*ROV, *THRUSTERS, "--buoyancy", "much"], 2, "--buoyancy 'much': give a force in N, or neutral"),
        ([*ROV, *THRUSTERS, "--cg", "1,2"], 1, "--cg: '1,2' is not x,y,z"),
        ([*ROV, *THRUSTERS, "--time-constant", "-1"], 1, "time constant: must be 0 s or more"),
        ([*ROV, *THRUSTERS, "--mesh", "hull.obj"], 2, "--mesh has its own length"),
        (["--mass", "5", *THRUSTERS, "--mesh", "nothing.obj"], 1, "nothing.obj: no such file or folder"),
    ],
)
def test_bad_input_gives_a_one_line_error(
    arguments: list[str], code: int, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert new(*arguments, "-o", tmp_path / "v.toml") == code
    printed = capsys.readouterr()
    assert words in printed.err
    assert (len(printed.err.splitlines()), printed.out) == (1, "")
    assert not (tmp_path / "v.toml").exists()


@pytest.mark.parametrize(
    ("content", "words"), [("solid\nfacet", "holds no faces"), (None, "not closed|closed hull|open")]
)
def test_an_invalid_mesh_gives_a_one_line_error(
    content: str | None, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = tmp_path / "hull.obj"
    if content is None:
        box_mesh(mesh, faces=5)
    else:
        mesh.write_text(content)
    assert new("--mass", 5, *THRUSTERS, "--mesh", mesh, "-o", tmp_path / "v.toml") == 1
    printed = capsys.readouterr().err
    assert len(printed.splitlines()) == 1
    assert any(word in printed for word in words.split("|")), printed
    assert "hull.obj" in printed


# On a terminal.


def on_terminal(answers: list[str], *arguments: object, cwd: Path) -> tuple[int, str]:
    """Exit code and everything printed, answers typed ahead."""
    leader, follower = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "hydro", "vehicle", "new", *map(str, arguments)],
        **{"stdin": follower, "stdout": follower, "stderr": follower, "cwd": cwd},
        env=os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "160", "TERM": "dumb"},
    )
    os.close(follower)
    os.write(leader, "".join(f"{answer}\n" for answer in answers).encode())
    printed = b""
    try:
        while chunk := os.read(leader, 65536):
            printed += chunk
    except OSError:  # the other end is closed: the command has ended
        pass
    os.close(leader)
    return process.wait(), printed.decode(errors="replace")


def test_answers_to_questions_make_the_same_file_as_options(tmp_path: Path) -> None:
    answers = ["Minnow", "heavy", "-3", "11.5", "0.46", "0.34", "0.25", "", "", "vectored6", "40", ""]
    code, printed = on_terminal(answers, cwd=tmp_path)
    assert code == 0, printed
    assert printed.count("a number above 0 is expected") == 2
    assert new(*ROV, *THRUSTERS, "--name", "Minnow", "-o", tmp_path / "options.toml") == 0
    assert (tmp_path / "Minnow.toml").read_text() == (tmp_path / "options.toml").read_text()


def test_only_missing_options_are_asked_for(tmp_path: Path) -> None:
    (tmp_path / "taken.toml").write_text("mine")
    answers = ["", "own", "0,0,0,1,0", "-0.2,0,0,1,0,0,40", "", "taken.toml", "mine.toml"]
    given = [*ROV, "--name", "x", "--buoyancy", "neutral"]
    code, printed = on_terminal(answers, *given, cwd=tmp_path)
    assert code == 0, printed
    assert "Dry mass" not in printed
    assert "the file exists already" in printed
    assert (tmp_path / "taken.toml").read_text() == "mine"
    assert len(vehicle.read(tmp_path / "mine.toml")[0].thruster) == 1
