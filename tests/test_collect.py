"""`hydro collect`: what is in the recording, what is not, and every way to ask for it wrongly."""

from __future__ import annotations

import contextlib
import io
import tomllib
from pathlib import Path

import numpy as np
import pytest
from streams_here import on_terminal, piped

from hydro import cli
from hydro.commands import collect
from hydro.core.vehicle.description import Vehicle
from hydro.io import table
from hydro.io.vehicle import parse

ROOT = Path(__file__).resolve().parents[1]
VEHICLE = ROOT / "datasets" / "vehicles" / "auv151.toml"
CURRENT = "ocean_current={v_N=0.31, v_E=0.17}"


def run(*arguments: object) -> tuple[int, str]:
    """Exit code and stderr of one `hydro collect` in this process."""
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        code = cli.main(["collect", *map(str, arguments)])
    assert out.getvalue() == ""
    return code, error.getvalue()


def recorded(path: Path, *arguments: object, vehicle: Path = VEHICLE) -> table.Artefact:
    """The artefact of a short recording."""
    assert run("--vehicle", vehicle, "--rows", 1500, *arguments, "-o", path) == (0, "")
    return table.read(path)


def test_a_recording_is_raw_data_with_its_vehicle_and_its_seed(tmp_path):
    artefact = recorded(tmp_path / "raw.parquet", "--seed", 3, "--noise", "ordinary")
    made = artefact.provenance
    assert (artefact.kind, artefact.frame.height, made.stage, made.seed) == ("raw", 1500, "collect", 3)
    assert made.vehicle == VEHICLE.read_text()
    assert isinstance(parse(made.vehicle), Vehicle)
    assert made.parameters["noise"] == {"velocity": 0.01, "rate": 0.002, "position": 0.02, "attitude": 0.001}
    assert made.parameters["ignored"] == ["added_mass", "linear_damping", "quadratic_damping"]


def test_the_same_seed_gives_the_same_content_on_any_number_of_threads(tmp_path):
    first = recorded(tmp_path / "a.parquet", "--seed", 5, "--threads", 1, "--noise", "dvl")
    again = recorded(tmp_path / "b.parquet", "--seed", 5, "--threads", 2, "--noise", "dvl")
    other = recorded(tmp_path / "c.parquet", "--seed", 6, "--noise", "dvl")
    assert first.provenance.content == again.provenance.content != other.provenance.content
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()


def test_the_truth_is_written_apart_and_never_in_the_recording(tmp_path):
    plain = recorded(tmp_path / "plain.parquet")
    truth = tmp_path / "truth.toml"
    hidden = ("--hide", CURRENT, "--hide", "payload={w=12.5, x=0.2}", "--truth", truth)
    artefact = recorded(tmp_path / "raw.parquet", *hidden)
    written = tomllib.loads(truth.read_text())
    assert written["effect"] == [
        {"name": "ocean_current", "v_N": 0.31, "v_E": 0.17},
        {"name": "payload", "w": 12.5, "x": 0.2},
    ]
    assert written["raw"] == artefact.provenance.content
    assert np.shape(written["panel"]["added_mass"]) == (6, 6)
    assert artefact.provenance.parameters == plain.provenance.parameters
    assert artefact.provenance.vehicle == plain.provenance.vehicle
    for secret in (b"ocean_current", b"payload", b"truth"):
        assert secret not in (tmp_path / "raw.parquet").read_bytes()
    assert not artefact.frame.equals(plain.frame)


def test_nothing_hidden_leaves_an_empty_truth(tmp_path):
    recorded(tmp_path / "raw.parquet", "--truth", tmp_path / "truth.toml")
    assert "effect" not in tomllib.loads((tmp_path / "truth.toml").read_text())


def test_the_replay_sequence_is_90_seconds(tmp_path):
    assert run("--vehicle", VEHICLE, "--excitation", "replay90", "-o", tmp_path / "replay.parquet") == (0, "")
    frame = table.read(tmp_path / "replay.parquet").frame
    assert frame.height == 4500
    assert frame["session"].unique().to_list() == ["replay90"]


def test_a_pipe_gives_the_bytes_of_the_file(tmp_path):
    recorded(tmp_path / "raw.parquet")
    done = piped("collect", "--vehicle", VEHICLE, "--rows", 1500)
    assert done == (0, (tmp_path / "raw.parquet").read_bytes(), b"")


def test_a_mesh_stands_beside_the_vehicle_file(tmp_path):
    def box(size: tuple[float, float, float]) -> str:
        corners = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
        faces = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
        lines = [f"v {' '.join(str(c * s) for c, s in zip(corner, size, strict=True))}" for corner in corners]
        return "\n".join([*lines, *(f"f {face}" for face in faces)])

    text = VEHICLE.read_text().replace("height = 0.5", 'height = 0.5\nmesh = "hull.obj"')
    vehicle = tmp_path / "boxy.toml"
    vehicle.write_text(text)
    (tmp_path / "hull.obj").write_text(box((1.4, 0.7, 0.5)))
    boxy = recorded(tmp_path / "boxy.parquet", vehicle=vehicle)
    assert not boxy.frame.equals(recorded(tmp_path / "plain.parquet").frame)
    (tmp_path / "hull.obj").write_text(box((1400, 700, 500)))
    code, error = run("--vehicle", vehicle, "--rows", 100, "-o", tmp_path / "none.parquet")
    assert (code, error.count("\n")) == (1, 1)
    assert "boxy.toml: hull.mesh: the mesh is" in error
    (tmp_path / "hull.obj").unlink()
    code, error = run("--vehicle", vehicle, "--rows", 100, "-o", tmp_path / "none.parquet")
    assert code == 1
    assert "hull.obj" in error


@pytest.mark.parametrize(
    ("arguments", "code", "complaint"),
    [
        (["--hide", "ocean_current"], 2, "write it like"),
        (["--hide", "ocean_current=0.3"], 2, "write it like"),
        (["--hide", "ocean_current={v_N=}"], 2, "write it like"),
        (["--hide", "ocean_curent={v_N=0.3}"], 2, "did you mean ocean_current"),
        (["--hide", "ocean_current={north=0.3}"], 2, "--hide ocean_current.north"),
        (["--hide", "ocean_current={v_N=inf}"], 2, "--hide ocean_current.v_N: must be finite"),
        (["--hide", "thruster_gain={g=[0.1]}"], 2, "--hide thruster_gain.g"),
        (["--hide", "added_mass={diagonal=[-900, 0, 0, 0, 0, 0]}"], 2, "--hide: effect"),
        (["--noise", "loud"], 2, "none, ordinary, dvl"),
        (["--noise", "{speed=0.1}"], 2, "velocity, rate, position"),
        (["--noise", "{velocity=-0.1}"], 2, "velocity must be a finite number"),
        (["--noise", "{velocity=nan}"], 2, "velocity must be a finite number"),
        (["--rows", "0"], 2, "--rows"),
        (["--seed", "-1"], 2, "--seed"),
        (["--depth", "-1"], 2, "--depth"),
        (["--teacher", "school"], 2, "--teacher"),
        (["--excitation", "jumps"], 2, "--excitation"),
        (["--vehicle", "absent.toml"], 1, "absent.toml: no such file"),
        (["--truth", "absent/truth.toml"], 1, "absent/truth.toml: no such file"),
    ],
)
def test_wrong_usage_is_told_in_one_line(arguments, code, complaint, tmp_path):
    line = ["--vehicle", VEHICLE, "--rows", 100, *arguments, "-o", tmp_path / "raw.parquet"]
    returned, error = run(*line)
    assert returned == code
    assert complaint in error
    assert error.startswith("hydro: ")
    assert error.count("\n") == 1
    assert not (tmp_path / "raw.parquet").exists()


def test_a_vehicle_without_thrusters_cannot_be_excited(tmp_path):
    adrift = tmp_path / "adrift.toml"
    head, _, tail = VEHICLE.read_text().partition("[[thruster]]")
    adrift.write_text(head + "[[effect]]" + tail.partition("[[effect]]")[2])
    code, error = run("--vehicle", adrift, "--rows", 100, "-o", tmp_path / "raw.parquet")
    assert code == 1
    assert "adrift.toml" in error
    assert "give it thrusters" in error


def test_a_vehicle_is_needed(tmp_path):
    code, error = run("--rows", 100, "-o", tmp_path / "raw.parquet")
    assert code == 2
    assert "--vehicle" in error


def test_progress_and_what_is_ignored_go_to_a_terminal(tmp_path):
    raw = tmp_path / "raw.parquet"
    code, printed = on_terminal("collect", "--vehicle", VEHICLE, "--rows", 3000, "-o", raw, term="xterm")
    assert code == 0
    assert "simulator replaces the vehicle file's added_mass, linear_damping, quadratic_damping" in printed
    assert "of 3,000 rows" in printed
    assert table.read(raw).frame.height == 3000


def test_many_rows_tell_how_long_they_take_once_their_pace_is_known(capsys):
    """A hundred rows a second after a first session of 40 s: what is left of two million takes 5.4 hours."""
    clock = iter([40.0, 140.0, 240.0])
    tell = collect._foretelling(2_000_000, lambda: next(clock))
    for done in (4_000, 14_000, 24_000, 34_000):
        tell(done)
    assert capsys.readouterr().err == "hydro: 2,000,000 rows (about 0.2 GB): about 5 hours left\n"
    few = collect._foretelling(1000, lambda: next(clock))
    few(1000)
    assert capsys.readouterr().err == ""
