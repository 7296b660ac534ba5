"""Every command: help, a runnable example, pipes equal to files, bad input in one line, exit codes."""

from __future__ import annotations

import contextlib
import io
import json
import os
import pty
import re
import runpy
import shlex
import shutil
import signal
import subprocess
import time
from pathlib import Path
from typing import Any, get_args, get_type_hints

import forked
import polars as pl
import pytest
from command_lines import parse, pasted_from
from streams_here import on_terminal, piped
from tables import shorten, shorten_text

from hydro import cli
from hydro.core.errors import DataError, UsageError
from hydro.io import table

ROOT = Path(__file__).resolve().parents[1]
COMMANDS = {command.__name__: example for group in cli.GROUPS for command, example in group.COMMANDS.items()}
ENVIRONMENT = os.environ | {"OMP_NUM_THREADS": "1"}


def hydro(*arguments: object, stdin: bytes = b"", cwd: Path = ROOT) -> subprocess.CompletedProcess[bytes]:
    """Run one command as a process of its own."""
    line = [forked.program(), *map(str, arguments)]
    return subprocess.run(line, input=stdin, capture_output=True, cwd=cwd, env=ENVIRONMENT, timeout=300)


@pytest.fixture(scope="session")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a short recording and what every stage makes of it, after one epoch of training."""
    folder = tmp_path_factory.mktemp("line")
    sample = table.read(ROOT / "datasets" / "stonefish" / "replay90.parquet")
    vehicle = ROOT / "datasets" / "stonefish" / "vehicle.toml"
    for name, rows in (("raw", 3000), ("shorter", 1700)):
        cut = table.make("raw", sample.frame.head(rows), stage="import", vehicle_text=vehicle.read_text())
        table.write(cut, folder / f"{name}.parquet")
    assert cli.main(["labels", str(folder / "raw.parquet"), "-o", str(folder / "labels.parquet")]) == 0
    split = ["split", str(folder / "labels.parquet"), "--blocks", str(folder / "blocks.parquet")]
    assert cli.main([*split, "-o", str(folder / "split.parquet")]) == 0
    train = ["train", str(folder / "split.parquet"), "--model", "mlp", "--epochs", "1"]
    assert cli.main([*train, "-o", str(folder / "model.parquet")]) == 0
    return folder


# What a user asks first.


def test_the_whole_line_has_commands() -> None:
    assert set(COMMANDS) >= {
        "check",
        "show",
        "labels",
        "split",
        "features",
        "train",
        "evaluate",
        "replay",
        "demo",
    }


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_a_paragraph_and_an_example(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([name, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"Usage: hydro {name}" in text
    assert len(text.split("\n\n")[2].split()) > 12, "a paragraph says what the command does"
    assert pasted_from(text)[-1] == COMMANDS[name]


def test_help_lists_every_command_once_in_its_section(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert cli.main([]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= 80
    listed = text.split("-o study")[1]
    for title, modules in cli.SECTIONS.items():
        section = listed.split(f"\n{title}:\n")[1].split("\n\n")[0]
        names = [line.split()[0] for line in section.splitlines()]  # one line each, the summary whole
        functions = [name.removesuffix("_") for one in modules if one in cli.GROUPS for name in names_of(one)]
        assert sorted(names) == sorted(functions + [one.NAME for one in modules if one in cli.FAMILIES])
        assert all(line.endswith(".") for line in section.splitlines())


def names_of(module: Any) -> list[str]:
    """Names of the functions of a module of commands."""
    return [command.__name__ for command in module.COMMANDS]


def test_help_shows_three_examples_that_parse(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == 0
    examples = pasted_from(capsys.readouterr().out)
    assert len(examples) == 3
    for example in examples:
        parse(example)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert re.fullmatch(r"hydro \d+\.\d+\.\d+\S*\n", capsys.readouterr().out)


def test_the_page_of_commands_is_current() -> None:
    generated = runpy.run_path(str(ROOT / "docs" / "generate_cli.py"))["page"]()
    assert (ROOT / "docs" / "cli.md").read_text() == generated, "run `make docs`"


APART = {"demo", "app", "warm"}
"""Commands that run elsewhere: `demo` takes minutes, `app` runs until Ctrl-C (`tests/app`), and
`make install` does the work of `warm`."""


@pytest.mark.parametrize("name", [name for name in COMMANDS if name not in APART])
def test_examples_run(name: str, tmp_path: Path, work: Path) -> None:
    """Each example runs as printed, in a folder with the files it names, the data a short recording."""
    data = tmp_path / "datasets" / "stonefish"
    data.mkdir(parents=True)
    shutil.copy(work / "raw.parquet", data / "sample.parquet")
    shutil.copy(work / "shorter.parquet", data / "replay90.parquet")
    (data / "vehicle.toml").write_bytes((ROOT / "datasets" / "stonefish" / "vehicle.toml").read_bytes())
    for folder in ("logs", "hidden"):
        shutil.copytree(ROOT / "datasets" / folder, data.parent / folder)
    shorten(data.parent / "hidden", 10.0, sessions=2)
    shorten_text(data.parent / "logs" / "example.csv", 420)
    for artefact in ("labels", "split", "model"):
        (tmp_path / f"{artefact}.parquet").write_bytes((work / f"{artefact}.parquet").read_bytes())
    handed_on = b""
    for part in COMMANDS[name].split("|"):
        done = piped(*shlex.split(part)[1:], stdin=handed_on, cwd=tmp_path)
        assert done.returncode == 0, done.stderr.decode()
        handed_on = done.stdout
    if target := re.search(r"-o (\S+\.(?:parquet|toml))", COMMANDS[name]):
        assert cli.main(["check", str(tmp_path / target[1])]) == 0


# Pipes.


def test_a_pipe_gives_the_bytes_of_files(work: Path) -> None:
    labels = hydro("labels", work / "raw.parquet")
    assert labels.stdout == (work / "labels.parquet").read_bytes()
    split = hydro("split", stdin=labels.stdout)
    assert split.stdout == (work / "split.parquet").read_bytes()
    model = hydro("train", "-", "--model", "mlp", "--epochs", 1, "-o", "-", stdin=split.stdout)
    assert model.stdout == (work / "model.parquet").read_bytes()
    assert labels.stderr + split.stderr + model.stderr == b"", "no progress and no tables off a terminal"


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("features", ["labels"]),
        ("evaluate", ["model", "--labels", "split"]),
        ("replay", ["raw", "--model", "model"]),
    ],
)
def test_findings_go_through_a_pipe_as_artefacts(
    name: str, arguments: list[str], work: Path, tmp_path: Path
) -> None:
    line = [str(work / f"{a}.parquet") if not a.startswith("-") else a for a in arguments]
    assert cli.main([name, *line, "-o", str(tmp_path / "file.parquet")]) == 0
    assert piped(name, *line) == (0, (tmp_path / "file.parquet").read_bytes(), b"")


def test_show_into_a_pipe_is_json_with_lineage_and_columns(work: Path) -> None:
    shown = json.loads(piped("show", work / "split.parquet").stdout)
    assert (shown["kind"], shown["stage"]) == ("split", "split")
    assert [shown["inputs"][0]["kind"], shown["inputs"][0]["inputs"][0]["kind"]] == ["labels", "raw"]
    surge = next(column for column in shown["columns"] if column["column"] == "u")
    assert (surge["unit"], surge["frame"]) == ("m/s", "body FRD")
    measured = table.read(work / "raw.parquet").frame["u"]
    assert (surge["min"], surge["max"]) == pytest.approx((measured.min(), measured.max()))


def test_a_closed_pipe_ends_quietly(work: Path) -> None:
    line = f"{forked.program()} labels {work}/raw.parquet | head -c 9 >/dev/null; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(
        ["bash", "-c", line], cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True, timeout=120
    )
    assert (done.stdout.strip(), done.stderr) == ("0", "")


# Terminals.


def on_terminal_of_a_process(*arguments: object) -> tuple[int, str]:
    """Run a process whose streams are one terminal, and return its exit code and everything printed."""
    leader, follower = pty.openpty()
    process = subprocess.Popen(
        [forked.program(), *map(str, arguments)],
        stdin=follower,
        stdout=follower,
        stderr=follower,
        cwd=ROOT,
        env=ENVIRONMENT | {"COLUMNS": "160", "TERM": "dumb"},
    )
    os.close(follower)
    printed = b""
    try:
        while chunk := os.read(leader, 65536):
            printed += chunk
    except OSError:  # the terminal's other end is closed: the command has ended
        pass
    os.close(leader)
    return process.wait(), printed.decode(errors="replace")


@pytest.mark.parametrize("name", ["labels", "split", "features", "train"])
def test_binary_never_goes_to_a_terminal(name: str, work: Path) -> None:
    source = {"labels": "raw", "split": "labels", "features": "labels", "train": "split"}[name]
    code, printed = on_terminal(name, work / f"{source}.parquet")
    assert code == 2
    assert printed.startswith("hydro: ")
    assert "-o FILE" in printed
    assert "PAR1" not in printed
    assert len(printed.splitlines()) == 1


def test_a_terminal_is_no_input() -> None:
    code, printed = on_terminal("labels", "-o", "never.parquet")
    assert code == 2
    assert len(printed.splitlines()) == 1
    assert not (ROOT / "never.parquet").exists()


def test_show_on_a_terminal_is_a_page(work: Path) -> None:
    code, printed = on_terminal_of_a_process("show", work / "labels.parquet")
    assert code == 0
    assert "labels: 3,000 rows in 1 session" in printed.replace("\x1b[1m", "").replace("\x1b[0m", "")
    assert "X_res" in printed
    assert "sha256:" in printed
    assert "stonefish-auv" in printed


def test_findings_on_a_terminal_are_tables(work: Path) -> None:
    code, printed = on_terminal("evaluate", work / "model.parquet", "--labels", work / "split.parquet")
    assert code == 0
    assert "rmse" in printed.lower()
    code, printed = on_terminal("replay", work / "raw.parquet", "--variant", "MJ0")
    assert code == 0
    assert "MJ0" in printed
    assert "m/s" in printed


def test_what_conditioning_did_is_told_on_a_terminal_and_in_the_metrics(work: Path, tmp_path: Path) -> None:
    start = table.read(work / "raw.parquet")
    text = start.provenance.vehicle  # a network of one epoch diverges later on
    table.write(
        table.make("raw", start.frame.head(200), stage="import", vehicle_text=text), tmp_path / "raw.parquet"
    )
    flight = ["replay", tmp_path / "raw.parquet", "--model", work / "model.parquet", "--variant", "MJ1"]
    code, printed = on_terminal(*flight, "--conditioning", "dead-band")
    assert code == 0
    assert "Conditioning dead-band" in printed
    assert "dead band" in printed.split("Conditioning dead-band")[1]
    files = ["--metrics", tmp_path / "errors.parquet", "-o", tmp_path / "replay.parquet"]
    assert run(*flight, "--conditioning", "dead-band", *files) == (0, "", "")
    errors = table.read(tmp_path / "errors.parquet", "metrics").frame
    held_back = errors.filter(pl.col("metric") == "held_back")["value"].item()
    assert 0.0 < held_back < 1.0, "the recording starts at rest"
    assert errors.filter(pl.col("metric") == "clipped")["value"].sum() == 0.0


def test_every_conditioning_can_be_asked_for_by_command_and_from_python() -> None:
    from hydro.api import networks
    from hydro.commands import replay
    from hydro.sim.residual.conditioning import PRESETS

    option = get_type_hints(replay.replay)["conditioning"]
    assert get_args(option) == get_args(networks.Conditioning) == PRESETS


def test_gaps_in_time_are_reported_once_and_only_where_there_are(work: Path, tmp_path: Path) -> None:
    whole = table.read(work / "raw.parquet")
    kept = pl.int_range(whole.frame.height) // 10 != 100
    broken = table.make(
        "raw", whole.frame.filter(kept), stage="import", vehicle_text=whole.provenance.vehicle
    )
    table.write(broken, tmp_path / "broken.parquet")
    code, _, error = run("labels", tmp_path / "broken.parquet", "-o", tmp_path / "labels.parquet")
    assert code == 0
    assert re.fullmatch(r"hydro: \S+broken.parquet: 1 gap in t, .*first: row 1000, .*\n", error), error
    code, _, error = run("split", tmp_path / "labels.parquet", "-o", tmp_path / "split.parquet")
    assert code == 0
    assert re.fullmatch(r"hydro: \S+labels.parquet: 1 gap in t, .*first: row 1000, .*\n", error), error


# Bad input: one line that says what, where and what to do.


CONSUMES = {
    "show": ("raw", []),
    "check": ("raw", []),
    "labels": ("raw", []),
    "split": ("labels", []),
    "features": ("labels", []),
    "train": ("split", ["--epochs", "1"]),
    "evaluate": ("split", ["{work}/model.parquet", "--labels"]),
    "replay": ("raw", ["--variant", "MJ0"]),
    "simulate": ("raw", [str(ROOT / "datasets" / "stonefish" / "vehicle.toml")]),
}
"""For each command the kind of its main input and what stands before it."""


def bad_files(folder: Path, good: Path) -> list[Path]:
    """Files that are not the table `good` but nearly."""
    names = ("missing", "empty", "text", "truncated", "nan", "backwards")
    missing, empty, text, truncated, nan, backwards = (folder / f"{name}.parquet" for name in names)
    empty.write_bytes(b"")
    text.write_text("session,t,u\nturn,0.0,1.0\n")
    truncated.write_bytes(good.read_bytes()[:5000])
    frame = table.read(good).frame
    frame.with_columns(pl.lit(float("nan"), pl.Float32).alias("u")).write_parquet(nan)
    frame.reverse().write_parquet(backwards)
    return [missing, empty, text, truncated, nan, backwards]


@pytest.mark.parametrize("name", CONSUMES)
def test_bad_input_is_told_in_one_line(name: str, work: Path, tmp_path: Path) -> None:
    kind, before = CONSUMES[name]
    files = bad_files(tmp_path, work / f"{kind}.parquet")
    if name not in ("show", "check"):
        files.append(work / ("blocks.parquet"))
    for file in files:
        line = [part.format(work=work) for part in before]
        output = [] if name in ("show", "check") else ["-o", tmp_path / "out.parquet"]
        code, out, error = run(name, *line, file, *output)
        assert (code, out) == (1, ""), file.name
        assert re.fullmatch(rf"hydro: .*{file.name}: .+\n", error), error
        assert not (tmp_path / "out.parquet").exists()


def test_every_command_that_reads_is_tried_with_bad_input() -> None:
    assert set(CONSUMES) >= {"check", "show", "labels", "split", "features", "train", "evaluate", "replay"}


def run(*arguments: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command in this process."""
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        code = cli.main([str(argument) for argument in arguments])
    return code, out.getvalue(), error.getvalue()


def test_check_tells_every_unsound_file_and_passes_sound_ones(work: Path, tmp_path: Path) -> None:
    files = bad_files(tmp_path, work / "raw.parquet")
    sound = [work / "raw.parquet", work / "model.parquet", ROOT / "datasets/stonefish/vehicle.toml"]
    code, out, error = run("check", *sound)
    assert (code, out) == (0, "")
    (audit,) = error.splitlines()
    assert audit == f"{sound[0]}: thrusters 1 to 8 push as the file says"
    assert run("check", *sound[:2]) == (0, "", "")
    code, _, error = run("check", *sound, *files)
    assert code == 1
    lines = [line for line in error.splitlines() if line != audit]
    assert len(lines) == len(files)
    assert all(file.name in line for file, line in zip(files, lines, strict=True))


def test_a_vehicle_is_taken_from_the_option_then_the_footer_and_missed_otherwise(
    work: Path, tmp_path: Path
) -> None:
    bare = tmp_path / "bare.parquet"
    table.read(work / "raw.parquet").frame.write_parquet(bare)
    code, _, error = run("labels", bare, "-o", tmp_path / "labels.parquet")
    assert code == 1
    assert "--vehicle" in error
    vehicle = ROOT / "datasets" / "stonefish" / "vehicle.toml"
    assert (
        cli.main(["labels", str(bare), "--vehicle", str(vehicle), "-o", str(tmp_path / "labels.parquet")])
        == 0
    )
    given = table.read(tmp_path / "labels.parquet").frame
    assert given.equals(table.read(work / "labels.parquet").frame)
    heavier = tmp_path / "heavier.toml"
    heavier.write_text(vehicle.read_text().replace("mass = 151.0", "mass = 200.0"))
    over = [
        "labels",
        str(work / "raw.parquet"),
        "--vehicle",
        str(heavier),
        "-o",
        str(tmp_path / "heavy.parquet"),
    ]
    assert cli.main(over) == 0
    assert not table.read(tmp_path / "heavy.parquet").frame["X_res"].equals(given["X_res"])


def test_vehicle_errors_name_the_file(tmp_path: Path, work: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(
        (ROOT / "datasets/stonefish/vehicle.toml").read_text().replace("mass = 151.0", "mass = -1.0")
    )
    for line in (
        ["check", wrong],
        ["labels", work / "raw.parquet", "--vehicle", wrong, "-o", tmp_path / "x"],
    ):
        code, _, error = run(*line)
        assert code == 1
        assert re.fullmatch(r"hydro: .*wrong\.toml.*mass.*\n", error)


# Exit codes.


@pytest.mark.parametrize(
    "arguments",
    [
        ["lables"],
        ["labels", "--acceleration", "magic"],
        ["labels", "--what"],
        ["split", "--test", "1.5"],
        ["train", "--epochs", "0"],
        ["train", "{raw}", "{raw}"],
        ["evaluate"],
        ["train", "{split}", "--model", "transformer", "-o", "x.parquet"],
        ["replay", "{raw}", "--variant", "MJ9", "-o", "x.parquet"],
    ],
    ids=" ".join,
)
def test_wrong_usage_is_exit_code_2_in_one_line(
    arguments: list[str], work: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = [argument.format(raw=work / "raw.parquet", split=work / "split.parquet") for argument in arguments]
    assert cli.main(line) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert re.fullmatch(r"hydro: .+\n", printed.err)


def test_a_mistyped_command_gets_a_suggestion(capsys: pytest.CaptureFixture[str]) -> None:
    cli.main(["lables"])
    assert "Did you mean 'labels'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (
            DataError("raw.parquet: u [m/s] must be finite"),
            1,
            r"hydro: raw.parquet: u \[m/s\] must be finite",
        ),
        (UsageError("no such variant"), 2, "hydro: no such variant"),
        (PermissionError(13, "Permission denied", "/data/x"), 1, "hydro: /data/x: permission denied"),
        (MemoryError(), 1, "hydro: not enough memory.*"),
        (KeyError("surge"), 3, "hydro: KeyError: 'surge'.*bug.*report.*"),
        (ValueError("two\nlines"), 3, "hydro: ValueError: two lines.*"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_errors_become_exit_codes(
    error: BaseException,
    code: int,
    line: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(*_: Any) -> None:
        raise error

    monkeypatch.setattr("hydro.io.table.read", fail)
    assert cli.main(["show", "raw.parquet"]) == code
    printed = capsys.readouterr()
    assert re.fullmatch(line + "\n", printed.err)
    assert "Traceback" not in printed.err


def test_an_interruption_is_exit_code_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("hydro.io.table.read", interrupt)
    assert cli.main(["show", "raw.parquet"]) == 130


def test_an_interruption_that_a_module_makes_something_else_of_is_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A module written in C that is interrupted while it is loaded says that it could not be."""

    def load(*_: Any) -> None:
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(1.0)
        except KeyboardInterrupt:
            pass
        raise ImportError("initialization failed")

    monkeypatch.setattr("hydro.io.table.read", load)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # workers of a test run ignore it
    try:
        assert cli.main(["show", "raw.parquet"]) == 130
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert "bug" not in capsys.readouterr().err


def test_debug_anywhere_adds_the_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["--debug", "show", "nothing.parquet"], ["show", "nothing.parquet", "--debug"]):
        assert cli.main(arguments) == 1
        printed = capsys.readouterr().err
        assert "Traceback" in printed
        assert printed.splitlines()[-1].startswith("hydro: nothing.parquet: ")
