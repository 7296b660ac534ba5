"""Inputs that never end are refused before a byte is read; pipes and the null device are what they were.

The device is a terminal whose other side is closed: what reads it all the same comes to an end at once.
"""

from __future__ import annotations

import os
import pty
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from hydro import cli
from hydro.core.errors import DataError, UsageError
from hydro.io.file_kind import kind
from hydro.io.files import bundled, read_bytes
from hydro.io.log import opened

RAW = bundled("stonefish") / "sample.parquet"
VEHICLE = bundled("stonefish") / "vehicle.toml"
LOG = bundled("logs") / "example.csv"
COMMANDS = (
    "check IT",
    "show IT",
    f"compare {VEHICLE} IT",
    f"compare {VEHICLE} {LOG} --map IT",
    f"compare IT {RAW}",
    f"fit {VEHICLE} IT --effect quadratic_damping -o out.toml",
    f"diagnose {VEHICLE} IT",
    f"explain {VEHICLE} IT -o out",
    "import IT --topics",
    "import IT -o out.parquet",
    f"import {LOG} --map IT -o out.parquet",
    "labels IT -o out.parquet",
    "split IT -o out.parquet",
    "features IT -o out.parquet",
    "train IT -o out.parquet",
    f"evaluate IT --labels {RAW}",
    "export IT -o out.onnx",
    "replay IT -o out.parquet",
    f"simulate {VEHICLE} IT -o out.parquet",
    f"add {VEHICLE} IT -o out.toml",
    "report IT -o out.html",
    "collect --vehicle IT -o out.parquet",
)


@pytest.fixture
def device() -> Iterator[str]:
    leader, follower = pty.openpty()
    os.close(leader)
    yield f"/proc/self/fd/{follower}"
    os.close(follower)


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_refuses_a_device(
    line: str,
    device: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(line.replace("IT", device).split()) == 1
    assert capsys.readouterr().err.splitlines()[-1] == (
        f"hydro: {device}: a device, not a file: name a file, or pipe a command into -"
    )
    assert not any(tmp_path.iterdir())


def test_a_hull_s_mesh_may_not_be_one(device: str) -> None:
    from hydro.io.mesh import read_obj

    with pytest.raises(DataError, match="a device, not a file"):
        read_obj(device)


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="there is no /dev/zero here")
def test_nor_may_stdin() -> None:
    with open("/dev/zero", "rb") as endless:
        for read in (read_bytes, lambda one: opened(one).__enter__()):
            with pytest.raises(DataError, match="stdin: a device, not a file"):
                read(endless)


def test_a_terminal_as_stdin_is_told_as_what_it_is() -> None:
    leader, follower = pty.openpty()
    with open(follower, "rb") as stream, pytest.raises(UsageError, match="nothing is piped in"):
        read_bytes(stream)
    os.close(leader)


def test_the_null_device_is_empty() -> None:
    with pytest.raises(DataError, match="empty file"):
        read_bytes(os.devnull)


def test_of_a_pipe_nothing_is_asked_again(tmp_path: Path) -> None:
    """A named pipe that somebody has read has no writer any more: opening it again would wait for ever."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    asked = threading.Thread(target=kind, args=(pipe,), daemon=True)
    asked.start()
    asked.join(10.0)
    waits = asked.is_alive()
    if waits:
        os.close(os.open(pipe, os.O_WRONLY))
    assert not waits


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash here")
@pytest.mark.parametrize(
    "line", ["check <(cat {0}) /dev/stdin < {0}", "labels <(cat {0}) -o /dev/null", "check - < <(cat {0})"]
)
def test_pipes_of_a_shell_are_read(line: str) -> None:
    line = f"'{sys.executable}' -m hydro.cli {line.format(RAW)}"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, ""), line
