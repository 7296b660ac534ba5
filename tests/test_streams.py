"""A stream that is full or closed is told in one line with exit code 1, as a file is; a reader may leave."""

from __future__ import annotations

import errno
import os
import resource
import subprocess
import sys
from pathlib import Path

import forked
import pytest
from matplotlib.figure import Figure

from hydro import cli
from hydro.commands import streams
from hydro.core.errors import DataError
from hydro.report.figures import save

ROOT = Path(__file__).resolve().parents[1]
SAMPLE = ROOT / "datasets" / "stonefish" / "sample.parquet"
LOG = ROOT / "datasets" / "logs" / "example.csv"
FULL = "hydro: stdout: no space left on the device: free some and run again\n"


def shell(line: str) -> tuple[str, str]:
    """What a line of the shell prints, where `hydro` and `SAMPLE` are known."""
    return command(forked.program(), line)


def closed(line: str) -> tuple[str, str]:
    """The same of a process that inherits its streams closed or open, as the line leaves them."""
    return command(f"{sys.executable} -m hydro.cli", line)


def command(program: str, line: str) -> tuple[str, str]:
    known = f'hydro() {{ {program} "$@"; }}; SAMPLE={SAMPLE}; '
    done = subprocess.run(["bash", "-c", known + line], cwd=ROOT, capture_output=True, text=True, timeout=120)
    return done.stdout, done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is always full")
@pytest.mark.parametrize(
    "command",
    ["--help", "labels --help", "--version", "effects", "show $SAMPLE", f"import {LOG} --write-map -"],
)
def test_a_full_disk(command: str) -> None:
    assert shell(f"hydro {command} >/dev/full; echo $?") == ("1\n", FULL)


@pytest.mark.parametrize(
    ("command", "stream"),
    [
        *[(f"{command} >&-", "stdout") for command in ("--help", "show $SAMPLE", "labels $SAMPLE")],
        *[(f"{command} <&- >/dev/null", "stdin") for command in ("labels", "check -")],
    ],
)
def test_a_closed_stream(command: str, stream: str) -> None:
    told = f"hydro: {stream}: closed: leave it open, or name a file\n"
    assert closed(f"hydro {command}; echo $?") == ("1\n", told)


def test_closed_streams_that_are_not_needed(tmp_path: Path) -> None:
    line = f"hydro labels $SAMPLE -o {tmp_path}/labels.parquet <&- >&- 2>&-; echo $?"
    assert closed(line) == ("0\n", "")
    assert closed(f"hydro check {tmp_path}/labels.parquet; echo $?") == ("0\n", "")


def test_an_error_that_is_no_write_is_not_blamed_on_stdout(tmp_path: Path, monkeypatch) -> None:
    told = streams.failure(OSError(errno.EINVAL, "Invalid argument"))
    assert told == "invalid argument: the operating system refused; --debug shows where"
    full = OSError(errno.ENOSPC, "No space left on device")
    assert streams.failure(full).startswith("stdout: no space left")
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    told = streams.failure(OSError(errno.ENOENT, "No such file or directory"))
    assert told == "the working directory has been removed: change to another one and run again"


def test_a_message_with_control_characters_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """As of a damaged file: a name from it must not move the cursor or begin another line."""
    assert cli._report("a.parquet: a \n table with \x1b[31m, \u2028 and é ≥ 5", 1) == 1
    assert capsys.readouterr().err == "hydro: a.parquet: a \\n table with \\x1b[31m, \\u2028 and é ≥ 5\n"


@pytest.mark.parametrize("command", ["--help", "effects", "labels $SAMPLE"])
def test_a_reader_that_leaves(command: str) -> None:
    assert shell(f"hydro {command} | true; echo ${{PIPESTATUS[0]}}") == ("0\n", "")


def test_a_reader_of_messages_that_leaves_ends_no_work(tmp_path: Path) -> None:
    line = f"hydro import {LOG} --map {LOG.with_name('map.toml')} -o {tmp_path}/raw.parquet"
    assert shell(f"{line} 2>&1 >/dev/null | true; echo ${{PIPESTATUS[0]}}") == ("0\n", "")
    assert (tmp_path / "raw.parquet").stat().st_size > 10_000


def test_a_figure_that_does_not_fit(tmp_path: Path) -> None:
    path = tmp_path / "figure.png"
    path.write_bytes(b"the one before")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        with pytest.raises(DataError, match=r"figure\.png: file too large"):
            save(Figure(), path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [one.read_bytes() for one in tmp_path.iterdir()] == [b"the one before"]
