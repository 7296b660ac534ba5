"""Files appear whole or not at all; whatever the operating system refuses is told in one line."""

from __future__ import annotations

import errno
import io
import os
import stat
import subprocess
import threading
from pathlib import Path

import pytest

from hydro.core.errors import DataError, UsageError
from hydro.io import files
from hydro.io.files import read_bytes, whole_file, write_bytes

OLD, NEW = b"what was there before", b"what comes now"


@pytest.fixture
def target(tmp_path: Path) -> Path:
    """A file that exists already."""
    path = tmp_path / "out.parquet"
    path.write_bytes(OLD)
    return path


def untouched(target: Path) -> bool:
    """Whether the former file is as it was, and nothing else lies beside it."""
    return target.read_bytes() == OLD and os.listdir(target.parent) == [target.name]


def test_a_file_is_replaced_whole(target: Path) -> None:
    write_bytes(NEW, target)
    assert target.read_bytes() == NEW
    assert os.listdir(target.parent) == [target.name]


def test_a_reader_of_the_former_file_keeps_it(target: Path) -> None:
    with open(target, "rb") as reader:
        write_bytes(NEW, target)
        assert reader.read() == OLD


def test_the_rights_are_those_of_any_new_file(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_bytes(NEW, tmp_path / "a")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o640


@pytest.mark.parametrize("mode", [0o600, 0o664])
def test_a_file_that_is_replaced_keeps_its_rights(target: Path, mode: int) -> None:
    target.chmod(mode)
    write_bytes(NEW, target)
    assert stat.S_IMODE(target.stat().st_mode) == mode


def test_a_file_that_may_not_be_written_is_not_replaced(target: Path, monkeypatch) -> None:
    """The super-user may write any file, so the system's answer is that of another user."""
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != target)
    with pytest.raises(DataError, match=r"permission denied: change the file's rights"):
        write_bytes(NEW, target)
    with pytest.raises(DataError, match=r"permission denied"):
        files.check_file(target)
    assert untouched(target)


@pytest.mark.skipif(not os.path.exists("/dev/fd"), reason="there are no paths of open files")
def test_an_open_pipe_is_written_to_by_its_path() -> None:
    """As the shell names it in `-o /dev/stdout | cat` and `-o >(cat)`."""
    reader, writer = os.pipe()
    with os.fdopen(reader, "rb") as end, os.fdopen(writer, "wb") as own:
        files.check_file(f"/dev/fd/{writer}")
        write_bytes(NEW, f"/dev/fd/{writer}")
        own.close()
        assert end.read() == NEW


@pytest.mark.parametrize("failure", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_failure_leaves_nothing_behind(
    target: Path, monkeypatch, failure: BaseException, call: str
) -> None:
    def fail(*_: object) -> None:
        raise failure

    monkeypatch.setattr(files.os, call, fail)
    with pytest.raises((DataError, KeyboardInterrupt)) as caught:
        write_bytes(NEW, target)
    assert untouched(target)
    if isinstance(caught.value, DataError):
        assert str(caught.value) == f"{target}: no space left on the device: free some and run again"


def test_an_error_inside_the_block_leaves_nothing_behind(target: Path) -> None:
    def interrupted() -> None:
        with whole_file(target) as stream:
            stream.write(NEW)
            raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match="mine"):
        interrupted()
    assert untouched(target)


def test_a_file_that_outgrows_its_limit(target: Path) -> None:
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(DataError, match="file too large"):
            write_bytes(b"x" * 100_000, target)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert untouched(target)


def test_a_symbolic_link_is_followed(target: Path) -> None:
    link = target.parent / "link"
    link.symlink_to(target)
    write_bytes(NEW, link)
    assert link.is_symlink()
    assert target.read_bytes() == NEW


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full here")
def test_a_device_is_written_to_and_not_replaced() -> None:
    write_bytes(NEW, "/dev/null")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    with pytest.raises(DataError, match="/dev/full: no space left on the device"):
        write_bytes(NEW, "/dev/full")
    with (
        open("/dev/full", "wb", buffering=0) as stream,
        pytest.raises(DataError, match="stdout: no space left"),
    ):
        write_bytes(NEW, stream)


def test_a_named_pipe_carries_bytes_both_ways(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=write_bytes, args=(NEW, pipe))
    writer.start()
    assert read_bytes(pipe) == NEW
    writer.join()
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize(
    ("place", "line"),
    [
        ("nowhere/out.parquet", "no such file or folder: check the path"),
        ("file/out.parquet", "part of this path is a file, not a folder: check the path"),
        ("", "this is a folder: name a file in it"),
        ("n" * 300, "file name too long: choose a shorter one"),
    ],
)
def test_a_place_that_cannot_be(tmp_path: Path, place: str, line: str) -> None:
    (tmp_path / "file").write_bytes(OLD)
    for attempt in (lambda: write_bytes(NEW, tmp_path / place), lambda: read_bytes(tmp_path / place)):
        with pytest.raises(DataError) as caught:
            attempt()
        assert str(caught.value) == f"{tmp_path / place}: {line}"
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.parametrize("number", [errno.EACCES, errno.EPERM])
def test_no_permission(target: Path, monkeypatch, number: int) -> None:
    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("builtins.open", refuse)
    with pytest.raises(
        DataError, match="permission denied: change the file's rights or choose another place"
    ):
        write_bytes(NEW, target)
    monkeypatch.undo()
    assert untouched(target)


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="rights do not bind the superuser")
def test_no_permission_for_real(target: Path) -> None:
    target.parent.chmod(0o500)
    try:
        with pytest.raises(DataError, match="permission denied"):
            write_bytes(NEW, target)
    finally:
        target.parent.chmod(0o700)
    assert untouched(target)


def test_an_unknown_failure_says_what_the_system_said(target: Path, monkeypatch) -> None:
    def fail(_: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(files.os, "fsync", fail)
    with pytest.raises(DataError, match="Input/output error: check the device and run again"):
        write_bytes(NEW, target)


def test_nothing_to_read(tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    with pytest.raises(DataError, match="empty: empty file"):
        read_bytes(tmp_path / "empty")
    with pytest.raises(DataError, match="stdin: empty file"):
        read_bytes(io.BytesIO())


def test_a_reader_who_went_away_is_told_to_the_shell() -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    with open(write_end, "wb") as stream:
        with pytest.raises(BrokenPipeError):
            write_bytes(NEW, stream)
        stream.raw.close()


def test_a_terminal_is_neither_read_nor_written() -> None:
    leader, follower = os.openpty()
    with open(follower, "r+b", buffering=0) as terminal:
        with pytest.raises(UsageError, match="-o FILE"):
            write_bytes(NEW, terminal)
        with pytest.raises(UsageError, match="name a file"):
            read_bytes(terminal)
    os.close(leader)


def test_a_name_that_would_break_the_line_is_escaped(tmp_path: Path) -> None:
    with pytest.raises(DataError) as caught:
        read_bytes(tmp_path / "two\nlines")
    assert "\n" not in str(caught.value)
    assert "two\\nlines" in str(caught.value)


@pytest.mark.skipif(os.name != "posix", reason="processes are looked up as POSIX does")
def test_what_a_killed_process_left_unfinished_is_removed(target: Path) -> None:
    ended = subprocess.Popen(["true"])
    ended.wait()
    ours = f".{target.name}.{files._machine()}-"
    litter = target.with_name(f"{ours}{ended.pid}-ab12.tmp")
    at_work = target.with_name(f"{ours}{os.getpid()}-ab12.tmp")
    elsewhere = target.with_name(f".{target.name}.00000000-{ended.pid}-ab12.tmp")
    for path in (litter, at_work, elsewhere):
        path.write_bytes(NEW)
    write_bytes(NEW, target)
    assert not litter.exists()
    assert at_work.exists()
    assert elsewhere.exists()
