"""A folder of results is one command's at a time, and a lock that a kill left behind holds nobody up."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from tables import raw

import hydro
from hydro import cli
from hydro.core.errors import DataError
from hydro.io.lock import LOCK, OWNER, alone

HOLD = """
import sys
from hydro.io.lock import alone
with alone(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process, which holds the folder `study`."""
    line = [sys.executable, "-c", HOLD, str(tmp_path / "study")]
    with subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_the_second_is_told_who_holds_the_folder(holder: subprocess.Popen[str], tmp_path: Path) -> None:
    told = rf"study: in use by process {holder.pid} on .* since \d{{4}}-"
    with pytest.raises(DataError, match=told), alone(tmp_path / "study"):
        pytest.fail("held twice")
    assert sorted(path.name for path in (tmp_path / "study").iterdir()) == [LOCK, OWNER]
    holder.communicate("")
    assert not (tmp_path / "study").exists(), "the holder has put nothing in it"


def test_a_command_is_refused_in_one_line(
    holder: subprocess.Popen[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    hydro.write(raw(), "raw.parquet", "raw")
    for command in (
        ["explain", "vehicle.toml", "raw.parquet"],
        ["rl", "train", "vehicle.toml"],
        ["rl", "study", "vehicle.toml"],
        ["study", "models", "raw.parquet", "--replay", "raw.parquet"],
    ):
        assert cli.main([*command, "-o", "study"]) == 1
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.count("\n") == 1
        assert f"study: in use by process {holder.pid}" in printed.err
        assert "name another folder" in printed.err


def test_what_a_kill_leaves_behind_holds_nobody_up(holder: subprocess.Popen[str], tmp_path: Path) -> None:
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    assert (tmp_path / "study" / LOCK).exists()
    with alone(tmp_path / "study"):
        (tmp_path / "study" / "result").touch()
    assert [path.name for path in (tmp_path / "study").iterdir()] == ["result"]


def test_a_folder_in_which_nothing_came_to_be_goes_again(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), alone(tmp_path / "new" / "study"):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "there").mkdir()
    with alone(tmp_path / "there"):
        pass
    assert list((tmp_path / "there").iterdir()) == []
    with alone(tmp_path / "new" / "study"):
        (tmp_path / "new" / "study" / "result").touch()
    assert [path.name for path in (tmp_path / "new" / "study").iterdir()] == ["result"]


def test_two_folders_are_held_apart(tmp_path: Path) -> None:
    with alone(tmp_path), alone(tmp_path / "inner"):
        assert (tmp_path / LOCK).exists()
        assert (tmp_path / "inner" / LOCK).exists()
