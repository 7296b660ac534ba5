"""A pipe carries the same bytes as a file would, and ends as quietly."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import polars as pl
import pytest
from tables import raw

from hydro.core.errors import DataError
from hydro.io import table
from hydro.io.table import Artefact

ROWS = 30_000
"""More than a pipe holds at once."""


def stage(source: Artefact) -> Artefact:
    """A stage as commands have them: a pure function between a read and a write."""
    motion = source.frame.select(pl.exclude("^cmd_.*$")).with_columns(variant=pl.lit("measured"))
    return table.make("replay", motion, stage="replay", parameters={"beta": 0.9}, inputs=[source])


def test_a_pipe_gives_the_bytes_of_files(tmp_path: Path) -> None:
    first = table.make("raw", raw(ROWS), stage="collect", seed=1)
    table.write(first, tmp_path / "raw.parquet")
    table.write(stage(table.read(tmp_path / "raw.parquet")), tmp_path / "replay.parquet")

    (out_1, in_1), (out_2, in_2) = os.pipe(), os.pipe()

    def collect() -> None:
        with open(in_1, "wb") as stdout:
            table.write(first, stdout)

    def replay() -> None:
        with open(out_1, "rb") as stdin, open(in_2, "wb") as stdout:
            table.write(stage(table.read(stdin, "raw")), stdout)

    commands = [threading.Thread(target=collect), threading.Thread(target=replay)]
    for command in commands:
        command.start()
    with open(out_2, "rb") as stdin:
        piped = stdin.read()
    for command in commands:
        command.join()
    assert piped == (tmp_path / "replay.parquet").read_bytes()


def test_a_command_that_failed_upstream_is_suspected() -> None:
    read_end, write_end = os.pipe()
    os.close(write_end)
    with (
        open(read_end, "rb") as stdin,
        pytest.raises(DataError, match="stdin: empty file"),
    ):
        table.read(stdin)


def test_a_command_that_died_upstream_leaves_a_cut_table() -> None:
    read_end, write_end = os.pipe()
    with open(write_end, "wb") as stdout:
        stdout.write(b"PAR1 and then nothing more")
    with (
        open(read_end, "rb") as stdin,
        pytest.raises(DataError, match="stdin: this Parquet file is cut short"),
    ):
        table.read(stdin)


def test_a_reader_who_goes_away_ends_the_writer() -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    artefact = table.make("raw", raw(ROWS), stage="collect")
    with open(write_end, "wb", buffering=0) as stdout, pytest.raises(BrokenPipeError):
        table.write(artefact, stdout)
