"""Named pipes as inputs: read when a program writes into them, and refused in one line when none does."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from hydro.core.errors import DataError
from hydro.io import log, mesh, pipe, sealed
from hydro.io.files import read_bytes

CUBE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture
def fifo(tmp_path: Path) -> Path:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    return path


def spoken(path: Path, content: bytes, after: float = 0.0) -> None:
    """Open the pipe for writing in another thread, and write after some seconds."""

    def write() -> None:
        with path.open("wb") as stream:
            time.sleep(after)
            stream.write(content)

    threading.Thread(target=write, daemon=True).start()


@pytest.mark.parametrize("read", [read_bytes, mesh.read_obj, log.read])
def test_a_pipe_into_which_no_program_writes_is_refused(
    read: Callable[[Path], object], fifo: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipe, "WAIT", 0.05)
    before = threading.active_count()
    with pytest.raises(DataError, match="pipe: no program writes into this pipe: name a file"):
        read(fifo)
    assert threading.active_count() == before


def test_a_writer_may_take_its_time(fifo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipe, "WAIT", 0.1)
    spoken(fifo, CUBE, after=0.3)
    assert mesh.read_obj(fifo)[1].tolist() == [[0, 1, 2]]
    spoken(fifo, b"t,u\n0,1\n1,2\n", after=0.3)
    assert log.read(fifo).frame.height == 2


def test_a_file_that_must_be_read_twice_is_no_pipe(fifo: Path) -> None:
    with pytest.raises(DataError, match="a pipe, not a file"), sealed.reading(fifo):
        pass
