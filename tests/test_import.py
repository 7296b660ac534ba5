"""`hydro import`, from a file to a raw artefact: round trips, what it says, and bad input in one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import logs
import numpy as np
import polars as pl
import pytest
import tomlkit
from hypothesis import HealthCheck, given, settings

from hydro import cli
from hydro.core.recording.segments import segments
from hydro.io import table

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE, MAP = (str(ROOT / "datasets" / "logs" / name) for name in ("example.csv", "map.toml"))
VEHICLE = str(ROOT / "datasets" / "logs" / "rov.toml")


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """Exit code and what went to stderr."""
    code = cli.main(["import", *map(str, arguments)])
    return code, capsys.readouterr().err


def written(folder: Path, raw: pl.DataFrame, how: logs.Convention, suffix: str = "csv") -> tuple[Path, Path]:
    """A log of that convention and its map, as files."""
    log, spec = logs.written(raw, how)
    path, map_file = folder / f"log.{suffix}", folder / "map.toml"
    if suffix == "csv":
        log.write_csv(path)
    else:
        log.write_parquet(path)
    map_file.write_text(tomlkit.dumps(spec))
    return path, map_file


@given(how=logs.conventions)
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_recording_survives_the_way_through_a_csv_of_any_convention(
    how: logs.Convention, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    raw = logs.raw(3.0, 20.0, sessions=("turn", "dive"))
    path, map_file = written(tmp_path, raw, how)
    code, error = run(capsys, path, "--map", map_file, "--strict", "-o", tmp_path / "raw.parquet")
    assert code == 0, error
    assert error.startswith("120 rows at 20 Hz in 2 sessions\n")
    found = table.read(tmp_path / "raw.parquet", "raw").frame
    assert found["session"].to_list() == raw["session"].to_list()
    apart = (found.drop("session") - raw.drop("session")).to_numpy()
    apart[:, 4:7] = np.angle(np.exp(1j * apart[:, 4:7]))
    assert np.abs(apart).max() < (2e-6 if how.time == "iso" else 1e-8)


def test_csv_parquet_and_stdin_are_the_same_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = []
    for suffix in ("csv", "parquet"):
        path, map_file = written(tmp_path, logs.raw(3.0), logs.ROS, suffix)
        assert run(capsys, path, "--map", map_file, "-o", tmp_path / f"{suffix}.raw")[0] == 0
        frames.append(table.read(tmp_path / f"{suffix}.raw").frame)
    assert frames[0].equals(frames[1])


def test_the_example_is_imported_with_its_gap_and_follows_its_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "raw.parquet"
    code, error = run(capsys, EXAMPLE, "--map", MAP, "--vehicle", VEHICLE, "--strict", "-o", output)
    assert code == 0
    assert "rows at 20 Hz in 2 sessions" in error
    assert "gaps left open: 1, 3.4 s in all; the longest, 3.4 s, after 19.8 s of run-2" in error
    assert "pose and velocity agree: d(position)/dt to 0.0" in error
    assert "warning" not in error
    artefact = table.read(output, "raw")
    assert len(segments(artefact.frame)) == 3
    assert artefact.provenance.stage == "import"
    assert artefact.provenance.vehicle == Path(VEHICLE).read_text()
    assert [each.kind for each in artefact.provenance.inputs] == ["log", "vehicle"]
    assert artefact.provenance.parameters["map"]["velocity"]["frame"] == "FLU"
    assert artefact.frame["z"].mean() == pytest.approx(4.0, abs=1.0)


def test_without_a_map_it_says_what_it_guessed_and_what_the_data_contradict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "raw.parquet"
    code, error = run(capsys, EXAMPLE, "-o", output)
    assert code == 0
    assert error.startswith(
        "guessed from the columns' names: time time_ms [ms]; session run; position north_m"
    )
    assert "warning: velocity looks FLU, not FRD as declared: d(position)/dt agrees to 0.0" in error
    assert 'set velocity.frame = "FLU"\n' in error
    output.unlink()
    code, error = run(capsys, EXAMPLE, "--strict", "-o", output)
    assert code == 1
    assert error.splitlines()[-1].startswith(f"hydro: {EXAMPLE}: velocity looks FLU, not FRD as declared")
    assert not output.exists()


def test_the_blanks_of_a_draft_are_an_error_that_says_where(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns = {"clock": [0.0, 0.1], "depth": [1.0, 1.1], "turn": [0.0, 0.0], "port": [0.0, 0.1]}
    pl.DataFrame(columns).rename({"clock": "t"}).write_csv(tmp_path / "log.csv")
    run(capsys, tmp_path / "log.csv", "--write-map", tmp_path / "map.toml")
    code, error = run(
        capsys,
        tmp_path / "log.csv",
        "--map",
        tmp_path / "map.toml",
        "--vehicle",
        VEHICLE,
        "-o",
        tmp_path / "raw",
    )
    assert code == 1
    assert "a column name in [attitude], [velocity], [rates] and [commands] is empty: fill in" in error


def test_a_raw_table_as_csv_needs_no_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    raw = logs.raw(8.0, noise=logs.ORDINARY)
    raw.write_csv(tmp_path / "raw.csv")
    code, error = run(capsys, tmp_path / "raw.csv", "--strict", "-o", tmp_path / "raw.parquet")
    assert code == 0
    assert "pose and velocity agree" in error
    found = table.read(tmp_path / "raw.parquet").frame.drop("session").to_numpy()
    np.testing.assert_allclose(found, raw.drop("session").to_numpy(), atol=1e-12)


def test_a_first_map_is_written_and_can_be_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    draft = tmp_path / "map.toml"
    assert run(capsys, EXAMPLE, "--write-map", draft) == (0, "")
    text = draft.read_text()
    assert "# Of the body about its axes x, y, z." in text
    draft.write_text(text.replace('frame = "FRD"\nunit = "m/s"', 'frame = "FLU"\nunit = "m/s"'))
    assert cli.main(["check", str(draft)]) == 0
    code, error = run(capsys, EXAMPLE, "--map", draft, "--strict", "-o", tmp_path / "raw.parquet")
    assert code == 0, error


def test_another_rate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, error = run(capsys, EXAMPLE, "--map", MAP, "--rate", 50, "-o", tmp_path / "raw.parquet")
    assert code == 0
    assert "rows at 50 Hz" in error
    assert run(capsys, EXAMPLE, "--map", MAP, "--rate", 0, "-o", tmp_path / "raw.parquet")[0] == 2


def test_commands_beyond_full_thrust_are_clipped_and_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    raw = logs.raw(3.0).with_columns(cmd_2=pl.lit(1.2))
    path, map_file = written(tmp_path, raw, replace(logs.ROS, commands="percent"))
    code, error = run(capsys, path, "--map", map_file, "-o", tmp_path / "raw.parquet")
    assert code == 0
    assert "warning: cmd_2 is beyond -1 to 1 in 150 rows and clipped" in error


BAD = {
    "unknown names": ("a,b\n1,2\n", None, "the columns' names do not identify time, position, attitude"),
    "no data": ("t,x\n", None, "no rows after the header"),
    "not a log": ("hello", None, "not a table"),
    "bad map": ("t,x\n1,2\n", "[time]\ncolumn = 't'\nunit = 'h'", "map.toml: time.unit: expected s or ms"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_nothing_is_written(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content, map_text, line = BAD[name]
    (tmp_path / "log.csv").write_text(content)
    arguments = [tmp_path / "log.csv", "-o", tmp_path / "raw.parquet"]
    if map_text is not None:
        (tmp_path / "map.toml").write_text(map_text)
        arguments += ["--map", tmp_path / "map.toml"]
    code, error = run(capsys, *arguments)
    assert code == 1
    assert len(error.splitlines()) == 1
    assert error.startswith("hydro: ")
    assert line in error
    assert not (tmp_path / "raw.parquet").exists()


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('"dvl_z"', '"dvl_q"', "no column is called dvl_q, which the map names in velocity: did you mean dv"),
        ('"servo7_raw", "servo8_raw",', "", "the map names 6 commands, but"),
        ('unit = "pwm"', "", "column servo1_raw, the command of thruster 1, reaches 1"),
        ('column = "run"', 'name = "all"', "example.csv: column time_ms goes backwards"),
    ],
)
def test_a_map_that_does_not_fit_the_log_is_one_line(
    old: str, new: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = Path(MAP).read_text()
    assert old in text
    (tmp_path / "map.toml").write_text(text.replace(old, new))
    source = Path(EXAMPLE).read_text()
    if "goes backwards" in line:
        rows = source.splitlines()
        source = "\n".join([rows[0], *reversed(rows[1:])])
    (tmp_path / "example.csv").write_text(source)
    arguments = ["--map", tmp_path / "map.toml", "--vehicle", VEHICLE, "-o", tmp_path / "raw.parquet"]
    code, error = run(capsys, tmp_path / "example.csv", *arguments)
    assert (code, len(error.splitlines())) == (1, 1)
    assert line in error


@pytest.mark.parametrize(
    ("blocks", "tells"),
    [
        (
            {"position": {"depth": "up"}},
            "note: frames and signs not tested: this needs attitude with rates, or position and attitude",
        ),
        ({"position": {"depth": "up"}, "velocity": {}}, "pose and velocity agree: d(position)/dt to "),
        ({"rates": {}}, "pose and velocity agree: the attitude's rate to "),
    ],
)
def test_a_log_without_some_sensors(
    blocks: dict[str, dict[str, str]], tells: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Depth and attitude, and a velocity; attitude and rates. What is there is tested, the rest is null."""
    log, spec = logs.written(logs.raw(20.0), replace(logs.Convention(), depth="depth"))
    taken = {name: block or spec[name] for name, block in blocks.items()}
    kept = {name: spec[name] for name in ("time", "session", "commands", "attitude")} | taken
    log.write_csv(tmp_path / "log.csv")
    (tmp_path / "map.toml").write_text(tomlkit.dumps(kept))
    arguments = [tmp_path / "log.csv", "--map", tmp_path / "map.toml", "--strict"]
    code, error = run(capsys, *arguments, "-o", tmp_path / "raw.parquet")
    assert code == 0
    assert tells in error
    assert "no sensor, null in every row: x, y" in error
    found = table.read(tmp_path / "raw.parquet", "raw").frame
    assert found["x"].null_count() == found.height
    assert found["phi"].null_count() == 0
    assert cli.main(["check", str(tmp_path / "raw.parquet")]) == 0
    assert "raw.parquet: no samples: x, y" in capsys.readouterr().err


def test_no_motion_follows_commands_of_stopped_thrusters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Commands a hundredth as large still correlate with the motion."""
    raw = logs.raw(20.0)
    drives = [name for name in raw.columns if name.startswith("cmd_")]
    delays = []
    for scale in (1.0, 0.01):
        scaled = raw.with_columns(pl.col(name) * scale for name in drives)
        log, spec = logs.written(scaled, logs.Convention())
        log.write_csv(tmp_path / "log.csv")
        (tmp_path / "map.toml").write_text(tomlkit.dumps(spec))
        _, error = run(
            capsys, tmp_path / "log.csv", "--map", tmp_path / "map.toml", "-o", tmp_path / "raw.parquet"
        )
        delays.append("the motion follows the commands" in error)
    assert delays == [True, False]


@pytest.mark.parametrize(
    ("command", "told"), [(0.0, "no thruster ran"), (0.4, "no command changes"), (None, "")]
)
def test_commands_that_show_nothing_of_the_thrusters_are_told(
    command: float | None, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    raw = logs.raw(10.0)
    drives = [name for name in raw.columns if name.startswith("cmd_")]
    constant = raw.with_columns(pl.lit(command).alias(name) for name in drives if command is not None)
    log, spec = logs.written(constant, logs.Convention())
    log.write_csv(tmp_path / "log.csv")
    (tmp_path / "map.toml").write_text(tomlkit.dumps(spec))
    code, error = run(
        capsys, tmp_path / "log.csv", "--map", tmp_path / "map.toml", "-o", tmp_path / "raw.parquet"
    )
    assert code == 0
    notes = [line for line in ("no thruster ran", "no command changes") if f"note: {line}" in error]
    assert notes == [told] * bool(told)


def test_a_wrong_sign_shows_without_a_horizontal_position(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, spec = logs.written(logs.raw(20.0), replace(logs.Convention(), depth="depth"))
    log.with_columns(v3=-log["v3"]).write_csv(tmp_path / "log.csv")
    kept = {name: block for name, block in spec.items() if name != "rates"} | {"position": {"depth": "up"}}
    (tmp_path / "map.toml").write_text(tomlkit.dumps(kept))
    code, error = run(
        capsys, tmp_path / "log.csv", "--map", tmp_path / "map.toml", "-o", tmp_path / "r.parquet"
    )
    assert code == 0
    assert "v3 looks reversed" in error


def test_the_example_is_small() -> None:
    assert Path(EXAMPLE).stat().st_size < 300_000
