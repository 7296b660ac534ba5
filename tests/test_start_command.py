"""`hydro start`: from a log to a report on a terminal and without one, bad input in one line, going on."""

from __future__ import annotations

import os
import pty
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import forked
import polars as pl
import pytest
from matplotlib.image import imread
from streams_here import on_terminal, piped
from tables import shorten_text

from hydro import cli
from hydro.core.guessing.interview import MOST
from hydro.io import logmap, table, vehicle
from hydro.io.files import bundled

ROV = bundled("logs") / "rov.toml"
TOO_SHORT = "fewer than 8 stretches of 2 s"
"""What explain says of a recording that is no use to it; all before it has been done then."""


def example(folder: Path, rows: int) -> Path:
    """Write the first rows of the bundled log, and return its path."""
    path = folder / "dive.csv"
    path.write_bytes((bundled("logs") / "example.csv").read_bytes())
    shorten_text(path, rows)
    return path


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a log that is too short for a diagnosis, and its vehicle file."""
    monkeypatch.chdir(tmp_path)
    example(tmp_path, 200)
    (tmp_path / "rov.toml").write_bytes(ROV.read_bytes())
    return tmp_path


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str]:
    """A folder in which a log has become a report without a terminal, and what was printed."""
    folder = tmp_path_factory.mktemp("start")
    example(folder, 420)
    (folder / "rov.toml").write_bytes(ROV.read_bytes())
    code, out, err = piped("start", "dive.csv", "--vehicle", "rov.toml", "-o", "out", cwd=folder)
    assert code == 0, err.decode()
    return folder, out.decode(), err.decode()


def commands(printed: str) -> list[str]:
    """The commands that were printed."""
    return re.findall(r"^hydro (?:vehicle|import|check|explain|report) .*$", printed, re.MULTILINE)


def refused(*arguments: object, code: int = 2, folder: Path | None = None) -> str:
    """The last line of a command that fails without a terminal."""
    done = piped("start", *arguments, cwd=folder)
    lines = done.stderr.decode().splitlines()
    assert done.returncode == code, lines
    assert len([line for line in lines if line.startswith("hydro: ")]) >= 1
    return lines[-1]


# From a log to a report.


def test_without_a_terminal_the_defaults_lead_to_a_report(done: tuple[Path, str, str]) -> None:
    folder, out, err = done
    out_folder = folder / "out"
    assert "velocity looks FLU, not FRD: corrected" in err
    assert logmap.read(out_folder / "map.toml").velocity == logmap.read(bundled("logs") / "map.toml").velocity
    assert [line.split()[1] for line in commands(err)] == ["import", "check", "explain", "report"]
    assert "thrusters 1 to 8 push as the file says" in err + out
    assert (out_folder / "report.html").stat().st_size > 1e6
    assert imread(out_folder / "recording.png").shape[1] > 600
    written = [Path(line.split()[0]) for line in out.splitlines() if re.match(r"(out|rov)\S+  ", line)]
    names = ["map.toml", "rov.toml", "raw.parquet", "recording.png", "study", "commands.sh", "report.html"]
    assert [path.name for path in written] == names
    assert all((folder / path).exists() for path in written)


def test_the_printed_commands_run_when_they_are_pasted(done: tuple[Path, str, str], tmp_path: Path) -> None:
    """In a folder with the log, the map and the vehicle file alone, they make the same recording."""
    folder, _, err = done
    for name in ("dive.csv", "rov.toml", "out/map.toml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    imported, check, *_ = commands(err)
    for line in (imported, check):
        assert piped(*shlex.split(line)[1:], cwd=tmp_path).returncode == 0
    assert (tmp_path / "out/raw.parquet").read_bytes() == (folder / "out/raw.parquet").read_bytes()


def test_the_script_repeats_the_commands(done: tuple[Path, str, str]) -> None:
    """All is there already, so that explain resumes; the page is made anew."""
    folder, _, err = done
    script = (folder / "out" / "commands.sh").read_text()
    assert [line.split(" || ")[0] for line in script.splitlines() if line.startswith("hydro ")] == commands(
        err
    )
    page = folder / "out" / "report.html"
    before = page.read_bytes()
    page.unlink()
    path = f"{Path(forked.program()).parent}{os.pathsep}{os.environ['PATH']}"
    run = subprocess.run(
        ["sh", folder / "out" / "commands.sh"],
        env=os.environ | {"PATH": path},
        capture_output=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr.decode()
    assert b"already done" in run.stderr
    assert page.read_bytes() == before


def test_completed_steps_are_not_repeated(done: tuple[Path, str, str]) -> None:
    folder, _, _ = done
    before = {path: path.stat().st_mtime_ns for path in (folder / "out").rglob("*.*") if path.is_file()}
    code, _, err = piped("start", "dive.csv", "--vehicle", "rov.toml", "-o", "out", cwd=folder)
    assert code == 0
    assert "out/map.toml: using the existing file" in err.decode()
    assert [line.split()[1] for line in commands(err.decode())] == ["check"]
    after = {path: path.stat().st_mtime_ns for path in before}
    assert {path.name for path in before if after[path] != before[path]} <= {"commands.sh"}


# Questions.


def test_answers_on_a_terminal_correct_the_map_and_make_a_vehicle(here: Path) -> None:
    """One line is corrected, and a vehicle is made of mass and box."""
    code, told = on_terminal(
        "start",
        "dive.csv",
        *("-o", "out"),
        answers=[
            "wrong",
            "commands",
            "?",
            "servo{1..6}_raw pwm",
            "vectored6",
            "9 0.5 0.4",
            "9 0.5 0.4 0.3 35",
        ],
    )
    assert code == 1, told
    asked = re.findall(r"^(\d)\. ", told, re.MULTILINE)
    assert len(set(asked)) == 4 <= MOST
    assert "'wrong' is not a line" in told
    assert "dvl_x dvl_y dvl_z" in told, "? lists the columns"
    assert "give four numbers above 0" in told
    meaning = logmap.read("out/map.toml")
    assert meaning.commands.columns == tuple(f"servo{number}_raw" for number in range(1, 7))
    assert meaning.velocity is not None
    assert meaning.velocity.frame == "FLU"
    known, _ = vehicle.read("out/vehicle.toml")
    assert (known.rigid_body.mass, known.hull.length, known.thruster[5].max_thrust) == (9.0, 0.5, 35.0)
    assert TOO_SHORT in told.splitlines()[-1]
    (new,) = re.findall(r"hydro (vehicle new .*?)\r", told)
    made = Path("out/vehicle.toml").read_bytes()
    assert cli.main(shlex.split(new)) == 0, "a pasted command runs again"
    assert Path("out/vehicle.toml").read_bytes() == made


def test_enter_takes_the_defaults(here: Path) -> None:
    code, told = on_terminal("start", "dive.csv", answers=["", ""])
    assert code == 1
    assert len(re.findall(r"^\d\. ", told, re.MULTILINE)) == 2
    assert "[none]" in told
    assert "[bluerov2_heavy]" in told
    kept = Path("dive-start/vehicle.toml").read_bytes()
    assert kept == (bundled("vehicles") / "bluerov2_heavy.toml").read_bytes()
    assert imread("dive-start/recording.png").shape[1] > 600


def test_unknown_column_names_lead_to_a_question_for_each_line(here: Path) -> None:
    frame = pl.read_csv("dive.csv").select(
        "time_ms", "depth_m", "gyro_x_deg_s", "gyro_y_deg_s", "gyro_z_deg_s"
    )
    blank = frame.rename(dict(zip(frame.columns[1:], "abcd", strict=True))).with_columns(e=0.1, f=-0.2)
    blank.write_csv("blank.csv")
    answers = ["", "depth=a", "", "", "b c d deg/s", "e f", "rov.toml"]
    code, told = on_terminal("start", "blank.csv", "-o", "out", answers=answers)
    assert len(re.findall(r"^\d\. ", told, re.MULTILINE)) == 7 <= MOST
    meaning = logmap.read("out/map.toml")
    assert meaning.position is not None
    assert meaning.position.depth == "a"
    assert meaning.rates is not None
    assert (meaning.rates.columns, meaning.rates.unit) == (("b", "c", "d"), "deg/s")
    assert (code, meaning.commands.columns) == (1, ("e", "f"))


def test_an_end_of_input_gives_a_one_line_error(here: Path) -> None:
    code, told = on_terminal("start", "dive.csv", "-o", "out", answers=["commands"])
    assert code == 2
    assert told.splitlines()[-1] == "hydro: the input ended before the last answer: give --commands"


def test_an_interrupt_at_a_question_ends_the_command(here: Path) -> None:
    """Libraries that read logs change how the process handles interrupts."""
    leader, follower = pty.openpty()
    line = [sys.executable, "-m", "hydro.cli", "start", "dive.csv", "-o", "out"]
    environment = os.environ | {"PYTHONPATH": str(Path(cli.__file__).parents[1]), "TERM": "dumb"}
    with subprocess.Popen(
        line,
        stdin=follower,
        stdout=follower,
        stderr=follower,
        env=environment,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        os.close(follower)
        printed = b""
        while b"> " not in printed:
            printed += os.read(leader, 65536)
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
    os.close(leader)
    assert not Path("out").exists()


def test_a_raw_table_needs_neither_map_nor_vehicle_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    whole = table.read(bundled("hidden") / "measured.parquet", ("raw",))
    made = table.make("raw", whole.frame.head(200), stage="import", vehicle_text=whole.provenance.vehicle)
    table.write(made, "raw.parquet")
    done = piped("start", "raw.parquet", "-o", "out")
    told = done.stderr.decode()
    assert done.returncode == 1, told
    assert [line.split()[1] for line in commands(told)] == ["check", "explain"]
    assert "results of explain" not in done.stdout.decode(), "explain refuses so short a recording"
    assert Path("out/vehicle.toml").read_text() == whole.provenance.vehicle
    assert imread("out/recording.png").shape[1] > 600


@pytest.mark.parametrize("log", ["cut.tlog", "ros2.mcap"])
def test_start_reads_other_log_formats(log: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The audit needs no diagnosis: with a wrong direction explain ends at once."""
    monkeypatch.chdir(tmp_path)
    file = bundled("vehicles") / "bluerov2_heavy.toml"
    assert cli.main(["vehicle", "flip", str(file), "--thruster", "1,2", "-o", "flipped.toml"]) == 0
    done = piped("start", bundled("dive") / log, "--vehicle", "flipped.toml", "--keep-thrusters", "-o", "out")
    told = done.stderr.decode()
    assert done.returncode == 1, told
    assert "thrusters 1 and 2 push opposite to the file" in told
    assert len(logmap.read("out/map.toml").commands.columns) == 8
    assert imread("out/recording.png").shape[1] > 600


@pytest.mark.parametrize("choice", [[], ["--keep-thrusters"]])
def test_thruster_directions_that_the_audit_contradicts_are_corrected_by_default(
    choice: list[str], here: Path
) -> None:
    example(here, 300)
    assert cli.main(["vehicle", "flip", "rov.toml", "--thruster", "1,2,3,4", "-o", "flipped.toml"]) == 0
    done = piped("start", "dive.csv", "--vehicle", "flipped.toml", *choice, "-o", "out")
    told = done.stderr.decode()
    assert ("--correct-thrusters" in commands(told)[-1]) == (not choice)
    assert ("explain continues with the audit's result" in told) == (not choice)
    assert commands(told)[-1] in Path("out/commands.sh").read_text()


# Going on.


def test_an_edited_map_repeats_only_the_steps_that_depend_on_it(here: Path) -> None:
    line = ("start", "dive.csv", "--preset", "bluerov2_heavy", "-o", "out")
    assert piped(*line).returncode == 1
    first = Path("out/raw.parquet").read_bytes()
    again = piped(*line).stderr.decode()
    assert [line.split()[1] for line in commands(again)] == ["check", "explain"], "imported already"
    path = Path("out/map.toml")
    path.write_text(path.read_text().replace('"dvl_x", "dvl_y"', '"dvl_y", "dvl_x"'))
    changed = piped(*line).stderr.decode()
    assert commands(changed)[0].startswith("hydro import")
    assert Path("out/raw.parquet").read_bytes() != first


def test_edited_files_are_not_overwritten(here: Path) -> None:
    """Options that say what is there are no contradiction: the same line goes on."""
    hull = ("--mass", 9, "--box", 0.5, 0.4, 0.3, "--layout", "vectored8")
    line = ("dive.csv", *hull, "--velocity", "dvl_{x,y,z} FLU", "-o", "out")
    for _ in range(2):
        assert TOO_SHORT in refused(*line, code=1)
    assert "out/vehicle.toml: the file exists and differs from the options" in refused(
        "dive.csv", "--preset", "auv151", "-o", "out", code=1
    )
    for name in ("map", "vehicle"):
        path = Path(f"out/{name}.toml")
        kept = path.read_text()
        path.write_text(f"{kept}# mine\n")
        assert f"{path}: the file exists and differs from the options" in refused(*line, code=1)
        assert path.read_text() == f"{kept}# mine\n"
        path.write_text(kept)


# Bad input.


def test_a_log_without_commands_says_which_option_gives_them(here: Path) -> None:
    pl.read_csv("dive.csv").drop(f"servo{number}_raw" for number in range(1, 9)).write_csv("bare.csv")
    assert refused("bare.csv", "-o", "out") == (
        "hydro: bare.csv: no columns found for commands: give them, such as --commands 'motor{1..6} pwm', or "
        "--map FILE; `hydro import bare.csv --topics` lists the columns"
    )
    assert not Path("out").exists(), "nothing is left behind"


def test_an_unknown_number_of_thrusters_asks_for_a_vehicle_file(here: Path) -> None:
    told = refused("dive.csv", "--commands", "servo{1..3}_raw pwm", "-o", "out")
    assert "dive.csv: Vehicle with 3 thrusters" in told
    assert told.endswith("give --preset NAME, --vehicle FILE, or --mass KG --box L W H")


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["none.csv"], 1, "none.csv: no such file or folder"),
        (["rov.toml"], 1, "rov.toml"),
        (["empty.csv"], 1, "empty.csv: empty file"),
        (["-"], 2, "give a file, not -"),
        (
            ["dive.csv", "--map", "rov.toml", "--rates", "none"],
            2,
            "--map defines these columns: leave --rates out",
        ),
        (["dive.csv", "--map", "rov.toml"], 1, "rov.toml"),
        (["dive.csv", "--vehicle", "none.toml"], 1, "none.toml: no such file or folder"),
        (["dive.csv", "--vehicle", "rov.toml", "--mass", "3"], 2, "--vehicle is complete"),
        (["dive.csv", "--preset", "bluerov2", "--layout", "bluerov2"], 2, "give one of them"),
        (["dive.csv", "--preset", "titanic"], 1, "unknown preset titanic: choose"),
        (["dive.csv", "--preset", "bluerov2"], 1, "bluerov2 has 6 thrusters, but the log has 8 commands"),
        (["dive.csv", "--mass", "3"], 1, "needs --box L W H"),
        (["dive.csv", "--velocity", "dvl_x dvl_y dvl_q"], 1, "no column is called dvl_q: did you mean dvl_"),
    ],
)
def test_bad_input_gives_a_one_line_error(arguments: list[str], code: int, told: str, here: Path) -> None:
    Path("empty.csv").touch()
    assert told in refused(*arguments, code=code)
