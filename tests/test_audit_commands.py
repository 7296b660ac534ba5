"""The thruster audit by `check`, `import`, `diagnose` and `explain`, and `vehicle flip`."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from recordings import damped, moved, noisy

import hydro
from hydro import cli
from hydro.io import toml, vehicle

TURNED = (0, 4)
"""Thrusters that push opposite to the file."""


def run(*arguments: object) -> int:
    return cli.main([*map(str, arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A vehicle file, a recording of it, and one with two command columns reversed."""
    folder = tmp_path_factory.mktemp("audit")
    hydro.write_vehicle(damped(), folder / "vehicle.toml")
    raw = noisy(moved(damped(), rows=2500), 0)
    hydro.write(raw, folder / "raw.parquet", "raw")
    turned = raw.with_columns(-pl.col(f"cmd_{i + 1}") for i in TURNED)
    hydro.write(turned, folder / "turned.parquet", "raw")
    return folder


@pytest.fixture(autouse=True)
def inside(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


def test_check_says_which_thrusters_push_opposite_and_the_flipped_file_agrees(capsys) -> None:
    assert run("check", "vehicle.toml", "raw.parquet") == 0
    assert "thrusters 1 to 8 push as the file says" in capsys.readouterr().err
    assert run("check", "vehicle.toml", "turned.parquet") == 1
    told = capsys.readouterr().err
    assert "thrusters 1 and 5 push opposite to the file" in told
    assert "`hydro vehicle flip vehicle.toml --thruster 1,5 -o flipped.toml`" in told
    assert run("vehicle", "flip", "vehicle.toml", "--thruster", "1,5", "-o", "flipped.toml") == 0
    assert run("check", "flipped.toml", "turned.parquet") == 0


def test_check_without_a_vehicle_or_with_another_one_audits_nothing(capsys, tmp_path) -> None:
    assert run("check", "turned.parquet") == 0
    few = damped()
    few = type(few)(**{**{f: getattr(few, f) for f in few.__struct_fields__}, "thruster": few.thruster[:6]})
    hydro.write_vehicle(few, tmp_path / "few.toml")
    capsys.readouterr()
    assert run("check", tmp_path / "few.toml", "turned.parquet") == 0
    assert "the thrusters are not audited" in capsys.readouterr().err


def test_check_reads_a_log_by_its_map(capsys, tmp_path) -> None:
    hydro.read("turned.parquet").write_csv(tmp_path / "log.csv")
    names = ", ".join(f'"cmd_{i + 1}"' for i in range(8))
    (tmp_path / "map.toml").write_text(
        'format = "hydro-map/1"\n[time]\ncolumn = "t"\nunit = "s"\n[session]\ncolumn = "session"\n'
        '[position]\ncolumns = ["x", "y", "z"]\nworld = "NED"\nunit = "m"\n'
        '[attitude]\ncolumns = ["phi", "theta", "psi"]\nworld = "NED"\nbody = "FRD"\nunit = "rad"\n'
        '[velocity]\ncolumns = ["u", "v", "w"]\nframe = "FRD"\nunit = "m/s"\n'
        '[rates]\ncolumns = ["p", "q", "r"]\nframe = "FRD"\nunit = "rad/s"\n'
        f'[commands]\ncolumns = [{names}]\nunit = "1"\n'
    )
    assert run("check", "vehicle.toml", tmp_path / "log.csv", "--map", tmp_path / "map.toml") == 1
    assert "thrusters 1 and 5 push opposite to the file" in capsys.readouterr().err
    raw = tmp_path / "raw.parquet"
    line = [tmp_path / "log.csv", "--map", tmp_path / "map.toml", "--vehicle", "vehicle.toml", "-o", raw]
    assert run("import", *line) == 0
    assert "warning: thrusters 1 and 5 push opposite to the file" in capsys.readouterr().err


def test_import_audits_no_thrusters_while_a_sensor_contradicts_its_frame(capsys, tmp_path) -> None:
    """A velocity along FLU that is read as FRD looks like swapped and reversed thrusters."""
    hydro.read("raw.parquet").with_columns(-pl.col("v", "w")).write_csv(tmp_path / "log.csv")
    line = [tmp_path / "log.csv", "--vehicle", "vehicle.toml", "-o", tmp_path / "raw.parquet"]
    assert run("import", *line) == 0
    told = capsys.readouterr().err
    assert "velocity looks FLU, not FRD as declared" in told
    assert "note: the thrusters are not audited: first correct the map as the warnings say" in told
    assert "drives thruster" not in told


def test_diagnose_names_no_effect_where_directions_are_wrong(capsys) -> None:
    assert run("diagnose", "vehicle.toml", "turned.parquet", "-o", "found.parquet") == 0
    (finding,) = hydro.read("found.parquet").iter_rows(named=True)
    assert (finding["verdict"], finding["effect"]) == ("log_fault", "")
    assert finding["members"] == ["cmd_1", "cmd_5"]
    assert finding["advice"].startswith("thrusters 1 and 5 push opposite to the file")
    assert "add --correct-thrusters" in finding["advice"]
    assert "vehicle.toml" not in finding["advice"]
    told = " ".join(capsys.readouterr().err.split())
    assert "The log has a fault: thrusters 1 and 5 push opposite to the file" in told
    assert told.count("hydro vehicle flip vehicle.toml --thruster 1,5") == 1


def test_explain_stops_where_directions_are_wrong(folder, capsys) -> None:
    assert run("explain", folder / "vehicle.toml", "turned.parquet", "-o", "study") != 0
    told = capsys.readouterr().err
    assert "turned.parquet: thrusters 1 and 5 push opposite to the file" in told
    assert f"`hydro vehicle flip {folder / 'vehicle.toml'} --thruster 1,5 -o flipped.toml`" in told
    assert "--correct-thrusters" in told


def test_diagnose_continues_with_correct_thrusters() -> None:
    assert run("diagnose", "vehicle.toml", "turned.parquet", "--correct-thrusters", "-o", "on.parquet") == 0
    found = hydro.read("on.parquet")
    assert found["verdict"].to_list() == ["log_fault", "nothing_missing"]


def test_flip_keeps_comments_and_everything_else(capsys) -> None:
    text = "# a comment\n" + toml.read("vehicle.toml")
    flipped = vehicle.flip_thrusters(text, [2])
    before, after = text.splitlines(), flipped.splitlines()
    changed = [(one, other) for one, other in zip(before, after, strict=True) if one != other]
    assert len(changed) == 1
    assert all(line.startswith("direction = ") for line in changed[0])
    one, other = (vehicle.parse(each).thruster for each in (text, flipped))
    np.testing.assert_array_equal(other[1].direction, -np.array(one[1].direction))
    assert [x for i, x in enumerate(one) if i != 1] == [x for i, x in enumerate(other) if i != 1]
    assert vehicle.flip_thrusters(flipped, [2]) == text


def test_flip_works_in_a_pipe(capsys, monkeypatch) -> None:
    text = toml.read("vehicle.toml")
    monkeypatch.setattr(sys, "stdin", io.StringIO(text))
    assert run("vehicle", "flip", "--thruster", "3", "--thruster", "4,5") == 0
    assert capsys.readouterr().out == vehicle.flip_thrusters(text, [3, 4, 5])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--thruster", "9"], "vehicle.toml: there is no thruster 9: it has 8"),
        (["--thruster", "0"], "there is no thruster 0"),
        (["--thruster", "two"], "--thruster: give the numbers"),
        ([], "--thruster: give the numbers"),
    ],
)
def test_a_thruster_that_cannot_be_flipped_gives_a_one_line_error(arguments, words, capsys) -> None:
    assert run("vehicle", "flip", "vehicle.toml", *arguments) != 0
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line


@pytest.mark.parametrize("layout", ["bluerov2", "bluerov2_heavy"])
def test_a_new_vehicle_can_have_the_curve_of_the_t200(layout, tmp_path) -> None:
    place = tmp_path / "rov.toml"
    size = ["--mass", 11.5, "--length", 0.46, "--width", 0.34, "--height", 0.25]
    assert (
        run("vehicle", "new", *size, "--layout", layout, "--curve", "t200", "--voltage", 15, "-o", place) == 0
    )
    known, _ = vehicle.read(place)
    assert len(known.thruster) == {"bluerov2": 6, "bluerov2_heavy": 8}[layout]
    assert {one.curve for one in known.thruster} == {"t200"}
    assert known.battery.voltage == 15.0


def test_voltage_without_a_curve_that_depends_on_it_is_refused(tmp_path, capsys) -> None:
    size = ["--mass", 11.5, "--length", 0.46, "--width", 0.34, "--height", 0.25]
    line = [*size, "--layout", "bluerov2", "--thrust", 40, "--voltage", 15, "-o", tmp_path / "rov.toml"]
    assert run("vehicle", "new", *line) != 0
    assert "only --curve t200 depends on it" in capsys.readouterr().err
