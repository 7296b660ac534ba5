"""Logs in the place of raw tables: `LOG --map FILE` is what `hydro import` and the command do one by one."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import logs
import message_logs
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from hydro import cli
from hydro.core.errors import DataError
from hydro.io import table

DATASETS = Path(__file__).resolve().parents[1] / "datasets"
MAP, VEHICLE = DATASETS / "logs" / "map.toml", DATASETS / "vehicles" / "bluerov2_heavy.toml"
COMMANDS = {
    "compare": ["compare", VEHICLE, "RAW"],
    "diagnose": ["diagnose", VEHICLE, "RAW"],
    "explain": ["explain", VEHICLE, "RAW", "-o", "study"],
    "fit": ["fit", VEHICLE, "RAW", "--effect", "linear_damping", "-o", "fitted.toml"],
    "labels": ["labels", "RAW", "--vehicle", VEHICLE, "-o", "made"],
    "replay": ["replay", "RAW", "--vehicle", VEHICLE, "--variant", "MJ0", "-o", "made"],
    "simulate": ["simulate", VEHICLE, "RAW", "-o", "made"],
}
"""Every command that takes a recording; RAW is where it stands."""
COMPUTED = {
    "compare": "hydro.core.evaluation.compare.compare",
    "diagnose": "hydro.core.diagnosis.pipeline.diagnose_log",
    "explain": "hydro.core.explanation.explain.explain",
    "fit": "hydro.core.identification.fit.fit",
    "hull": "hydro.core.diagnosis.pipeline.hull_of",
}
"""What a long computation is replaced by: it says which recording came in."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The two runs of the bundled log, each as a log and as the raw table that hydro import makes of it."""
    made = tmp_path_factory.mktemp("logs")
    both = pl.read_csv(DATASETS / "logs" / "example.csv", infer_schema=False)
    for name, run in (("dive", "run-1"), ("other", "run-2")):
        both.filter(pl.col("run") == run).head(300).write_csv(made / f"{name}.csv")
        for filled in ("", "--fill"):
            given = [made / f"{name}.csv", "--map", MAP, "--vehicle", VEHICLE, *filter(None, [filled])]
            line = ["import", *map(str, given), "-o", str(made / f"{name}{filled}.parquet")]
            assert cli.main(line) == 0
    return made


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[pl.DataFrame]:
    """The recordings that the long computations were given; each ends there."""
    found: list[pl.DataFrame] = []

    def computed(*given: Any, **named: Any) -> Any:
        found.append(next(getattr(one, "raw", one) for one in given[1:]))
        raise DataError("seen")

    for name in COMPUTED.values():
        monkeypatch.setattr(name, computed)
    return found


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, list[str]]:
    """Exit code and the lines on stderr."""
    capsys.readouterr()
    code = cli.main(list(map(str, arguments)))
    return code, capsys.readouterr().err.splitlines()


def line(name: str, *recording: object) -> list[object]:
    """The command line of a command with that recording."""
    return [part for each in COMMANDS[name] for part in (recording if each == "RAW" else [each])]


def test_every_command_that_takes_a_recording_takes_logs() -> None:
    import inspect

    takes = {
        command.__name__
        for group in cli.GROUPS
        for command in group.COMMANDS
        if "map_" in inspect.signature(command).parameters
    }
    assert takes == {*COMMANDS, "app", "check", "import", "start", "track"}


@pytest.mark.parametrize("name", ["labels", "replay", "simulate"])
def test_a_log_gives_what_its_raw_table_gives(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    raw = folder / ("dive--fill.parquet" if name == "replay" else "dive.parquet")
    code, told = run(capsys, *line(name, raw))
    assert code == 0, told
    expected = table.read("made")
    code, told = run(capsys, *line(name, folder / "dive.csv"), "--map", MAP)
    assert code == 0, told
    assert told[0] == f"{folder / 'dive.csv'} by {MAP}:"
    assert "pose and velocity agree" in "\n".join(told)
    found = table.read("made")
    number = ["dataset"] if "dataset" in found.frame.columns else []
    assert_frame_equal(found.frame.drop(number), expected.frame.drop(number))
    hashes = [[one.content for one in each.provenance.inputs] for each in (found, expected)]
    assert hashes[0] == hashes[1], "the table knows the same recording"


@pytest.mark.parametrize("name", ["compare", "diagnose", "explain", "fit"])
def test_a_log_is_computed_on_as_its_raw_table(
    name: str, folder: Path, seen: list[pl.DataFrame], capsys: pytest.CaptureFixture[str]
) -> None:
    lines = []
    for recording in ([folder / "dive.parquet"], [folder / "dive.csv", "--map", MAP]):
        code, told = run(capsys, *line(name, *recording))
        assert (code, told[-1].rpartition(": ")[2]) == (1, "seen")
        lines.append(told)
    assert_frame_equal(seen[1], seen[0])
    imported = run(capsys, "import", folder / "dive.csv", "--map", MAP, "--vehicle", VEHICLE, "-o", "raw")[1]
    assert lines[1][1 : 1 + len(imported)] == imported, "the same sentences"
    assert [each.replace(".csv", ".parquet") for each in lines[1][1 + len(imported) :]] == lines[0]


def test_other_recordings_of_a_command_are_logs_too(
    folder: Path, seen: list[pl.DataFrame], capsys: pytest.CaptureFixture[str]
) -> None:
    before = ["--map", MAP, "--before", folder / "other.csv"]
    for name in ("compare", "diagnose", "explain"):
        assert run(capsys, *line(name, folder / "dive.parquet"), *before)[1][-1].endswith("other.csv: seen")
        assert_frame_equal(seen[-1], table.read(folder / "other.parquet").frame)
    given = {}

    def steps(vehicle: Any, raw: pl.DataFrame, *, holdout: pl.DataFrame, **named: Any) -> Any:
        given["holdout"] = holdout
        raise DataError("seen")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(COMPUTED["explain"], steps)
        run(capsys, *line("explain", folder / "dive.csv"), "--map", MAP, "--holdout", folder / "other.csv")
    assert_frame_equal(given["holdout"], table.read(folder / "other.parquet").frame)


def test_the_recording_itself_as_a_log_is_no_other_recording(
    folder: Path, seen: list[pl.DataFrame], capsys: pytest.CaptureFixture[str]
) -> None:
    for option in ("--holdout", "--before"):
        more = [option, folder / "dive.csv", "--map", MAP]
        code, told = run(capsys, *line("explain", folder / "dive.parquet"), *more)
        assert code == 1
        assert "the same rows as the measured recording" in told[-1]


def test_the_files_of_one_dive_are_one_recording(
    folder: Path, seen: list[pl.DataFrame], capsys: pytest.CaptureFixture[str]
) -> None:
    whole = pl.read_csv(folder / "dive.csv", infer_schema=False)
    drive = [name for name in whole.columns if name.startswith("servo")]
    whole.drop(drive).write_csv("nav.csv")
    whole.select("time_ms", *drive).write_csv("drive.csv")
    Path("map.toml").write_text(MAP.read_text().replace('[session]\ncolumn = "run"', ""))
    files = ["nav.csv", "drive.csv"]
    assert run(capsys, "import", *files, "--map", "map.toml", "-o", "raw.parquet")[0] == 0
    told = run(capsys, *line("compare", *files), "--map", "map.toml")[1]
    assert told[0] == "nav.csv drive.csv by map.toml:"
    assert told[-1] == "hydro: nav.csv: seen"
    assert_frame_equal(seen[0], table.read("raw.parquet").frame)
    run(capsys, *line("compare", folder / "dive.parquet"), "--before", "nav.csv", "--before", "drive.csv",
        "--map", "map.toml")  # fmt: skip
    assert_frame_equal(seen[-1], seen[0])


def test_a_log_from_a_pipe(
    folder: Path,
    seen: list[pl.DataFrame],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for file, more in (("dive.csv", ["--map", MAP]), ("dive.parquet", [])):
        stream = io.BytesIO((folder / file).read_bytes())
        monkeypatch.setattr("sys.stdin", type("Stdin", (), {"buffer": stream})())
        assert run(capsys, *line("compare", *more))[1][-1] == "hydro: stdin: seen"
    assert_frame_equal(*seen)


@pytest.mark.parametrize("storage", ["MCAP", "SQLITE3"])
def test_a_bags_folder_is_a_log(storage: str, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rosbags", reason="needs the extra `logs`")
    bag = message_logs.ros2(logs.raw(3.0, 20.0), Path("bag"), storage)
    code, told = run(capsys, "labels", bag, "-o", "made")
    assert (code, len(told)) == (1, 1)
    assert "if it is a log, give --map FILE" in told[0]
    Path("map.toml").write_text(message_logs.ROS_MAP)
    code, told = run(capsys, "labels", bag, "--map", "map.toml", "-o", "made")
    assert told[:2] == ["bag by map.toml:", "60 rows at 20 Hz in 1 session"]
    assert "carries no vehicle in its footer: add --vehicle" in told[-1]


def test_definitions_of_messages_go_with_the_map(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rosbags", reason="needs the extra `logs`")
    bag = message_logs.custom(logs.raw(3.0, 20.0), Path("old.db3"), Path("msgs"))
    columns = '["/thrusters.setpoint[0]", "/thrusters.setpoint[1]"]'
    Path("map.toml").write_text(
        f'[position]\ndepth = "/thrusters.setpoint[0]"\n[commands]\ncolumns = {columns}\n'
    )
    given = ["labels", bag, "--map", "map.toml", "-o", "made"]
    without, found = (run(capsys, *given, *more)[1][-1] for more in ([], ["--msg", "msgs"]))
    assert "no definition of auv_msgs" in without
    assert "no definition" not in found


def test_hydros_own_table_needs_no_map_and_keeps_its_own(
    folder: Path, seen: list[pl.DataFrame], capsys: pytest.CaptureFixture[str]
) -> None:
    raw = folder / "dive.parquet"
    told = run(capsys, *line("compare", raw), "--map", MAP)[1]
    assert told[0] == f"hydro: {raw}: a table already, read without --map"
    assert_frame_equal(seen[0], table.read(raw).frame)


def test_a_log_in_parquet_is_a_log(
    folder: Path, seen: list[pl.DataFrame], capsys: pytest.CaptureFixture[str]
) -> None:
    pl.read_csv(folder / "dive.csv").write_parquet("log.parquet")
    code, told = run(capsys, *line("compare", "log.parquet"))
    assert (code, len(told)) == (1, 1)
    assert told[0].endswith("if it is a log, give --map FILE")
    run(capsys, *line("compare", "log.parquet"), "--map", MAP)
    assert_frame_equal(seen[0], table.read(folder / "dive.parquet").frame)


BAD = {
    "a log without a map": (
        ["dive.csv"],
        1,
        "dive.csv: not a Parquet file (text): if it is a log, give --map",
    ),
    "a bag without a map": (
        ["dive.bag"],
        1,
        "dive.bag: not a Parquet file (ROS 1 bag): if it is a log, give",
    ),
    "several without a map": (
        ["dive.csv", "other.csv"],
        2,
        "several files are the logs of one dive: without",
    ),
    "a table among logs": (["dive.csv", "dive.parquet", "--map", MAP], 2, "dive.parquet is a table already"),
    "no such log": (["nowhere.csv", "--map", MAP], 1, "nowhere.csv: no such file"),
    "no such map": (["dive.csv", "--map", "nowhere.toml"], 1, "nowhere.toml: no such file"),
    "a map that is none": (["dive.csv", "--map", VEHICLE], 1, "bluerov2_heavy.toml"),
    "a map of another log": (["alien.csv", "--map", MAP], 1, "no column is called"),
    "an empty log": (["empty.csv", "--map", MAP], 1, "empty.csv: empty file"),
    "what is no log": (["noise.bin", "--map", MAP], 1, "its first bytes are of no known format"),
    "a folder": (["folder", "--map", MAP], 1, "without metadata.yaml this folder is not"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_read_is_one_line(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("dive.csv").write_bytes((folder / "dive.csv").read_bytes())
    Path("dive.parquet").write_bytes((folder / "dive.parquet").read_bytes())
    Path("other.csv").write_text("a,b\n1,2\n")
    Path("alien.csv").write_text("a,b\n1,2\n")
    Path("empty.csv").touch()
    Path("dive.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(600))
    Path("noise.bin").write_bytes(bytes(range(256)) * 4)
    Path("folder").mkdir()
    given, code, words = BAD[name]
    found, told = run(capsys, *line("compare", *given))
    assert found == code
    assert words in told[-1]
    assert [each for each in told if each.startswith("hydro: ")] == told[-1:]


def test_a_map_with_other_thrusters_than_the_vehicle_is_told(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("map.toml").write_text(MAP.read_text().replace('"servo8_raw",', ""))
    code, told = run(capsys, *line("diagnose", folder / "dive.csv"), "--map", "map.toml")
    assert code == 1
    assert "the map names 7 commands, but" in told[-1]
