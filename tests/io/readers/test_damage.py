"""Files of every format cut short, with flipped bits, of the wrong kind: a table or one line.

`HYDRO_FUZZ=500` damages each format 500 times instead of a few dozen, `HYDRO_FUZZ_SEED=1` in other places.
"""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from pathlib import Path

import logs
import message_logs as written
import numpy as np
import pytest
from fuzz.mutations import damaged

from hydro import cli
from hydro.core.errors import DataError
from hydro.io import log

CASES = int(os.environ.get("HYDRO_FUZZ", "24"))
SEED = int(os.environ.get("HYDRO_FUZZ_SEED", "7"))
MOST = 300
"""Megabytes by which reading a damaged file of some kilobytes may raise the memory in use."""


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder, raw = tmp_path_factory.mktemp("sound"), logs.raw(1.0, 20.0)
    return {name: write(raw, folder / name) for name, (write, _) in written.WRITERS.items()}


def cases(content: bytes, seed: int) -> Iterator[bytes]:
    rng = np.random.default_rng(seed)
    yield from (damaged(content, rng) for _ in range(CASES))


def peak() -> float:
    """The most memory ever in use [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


@pytest.mark.parametrize("name", written.WRITERS)
def test_damage_is_a_table_or_one_line_in_bounded_memory(name, sound, tmp_path, capfd):
    log.read(sound[name])
    before, refused = peak(), []
    path = tmp_path / name
    for content in cases(sound[name].read_bytes(), SEED):
        path.write_bytes(content)
        try:
            assert log.read(path).frame.height > 0
        except DataError as error:
            refused.append(str(error))
    assert all(line.startswith(str(path)) for line in refused)
    assert not [line for line in refused if "\n" in line or len(line) > 500]
    assert refused or name in ("dive.tlog", "dive.ulg")
    assert peak() - before < MOST
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", written.WRITERS)
def test_what_is_cut_in_the_middle_is_refused_or_told(name, sound, tmp_path, capsys):
    """Logs without an end mark, as a vehicle without power leaves them, are read to their last message."""
    content = sound[name].read_bytes()
    (tmp_path / name).write_bytes(content[: len(content) // 2 + 3])
    (tmp_path / "map.toml").write_text(written.WRITERS[name][1])
    output = tmp_path / "raw.parquet"
    code = cli.main(["import", str(tmp_path / name), "--map", str(tmp_path / "map.toml"), "-o", str(output)])
    error = capsys.readouterr().err
    if name in ("dive.bin", "dive.tlog", "dive.log", "dive.ulg"):
        assert code == 0, error
        assert "note: the last message is cut short" in error
    else:
        assert (code, error.count("\n"), output.exists()) == (1, 1, False)
        assert name in error


@pytest.mark.parametrize("name", [*written.WRITERS, "dive.csv"])
@pytest.mark.parametrize(
    "content", [b"\x00" * 4000, bytes(range(256)) * 16, b"hello\nthere\n", b"\xa3\x95", b"PK\x03\x04"]
)
def test_what_is_no_log_is_one_line_whatever_it_is_called(name, content, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError) as caught:
        log.read(tmp_path / name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"MATLAB 7.3 MAT-file", "a MATLAB file of version 7.3, which is not read: convert it first"),
        (b"\x28\xb5\x2f\xfd....", "compressed with zstd"),
        (b"#ROSBAG V1.2\n", "a ROS bag of version 1"),
    ],
)
def test_known_formats_that_are_not_read_say_what_to_do(content, line, tmp_path):
    (tmp_path / "log").write_bytes(content)
    with pytest.raises(DataError, match=line):
        log.read(tmp_path / "log")


def test_a_folder_that_is_no_recording(tmp_path):
    with pytest.raises(DataError, match=r"without metadata\.yaml this folder"):
        log.read(tmp_path)


def test_a_missing_library_is_named_with_its_command(sound, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "rosbags.rosbag1", None)
    with pytest.raises(DataError, match=r"rosbags.*not installed: pip install 'deep-hydro-sim\[logs\]'"):
        log.read(sound["ros1.bag"])
