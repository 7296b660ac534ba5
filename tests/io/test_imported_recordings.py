"""Import of a log as a recording, by its map or by the names of its columns."""

from __future__ import annotations

from pathlib import Path

import logs
from polars.testing import assert_frame_equal

from hydro.io.log import opened
from hydro.io.recordings import imported

MAP = """
[time]
column = "t"
[position]
columns = ["x", "y", "z"]
[attitude]
columns = ["phi", "theta", "psi"]
[velocity]
columns = ["u", "v", "w"]
[commands]
columns = ["cmd_1", "cmd_2"]
"""


def test_without_a_map_what_was_guessed_is_told_and_with_one_it_is_not(tmp_path: Path):
    log, map_ = tmp_path / "dive.csv", tmp_path / "map.toml"
    logs.raw(4.0).drop("session", "p", "q", "r").write_csv(log)
    map_.write_text(MAP)
    told: dict[Path | None, str] = {}
    tables = []
    for given in (None, map_):
        lines: list[str] = []
        with opened(log) as file:
            tables.append(imported([file], given, lines.append).frame)
        told[given] = "\n".join(lines)
    assert_frame_equal(*tables)
    assert "guessed from the columns' names: " in told[None]
    assert "no column name identifies rates" in told[None]
    assert not any(words in told[map_] for words in ("guessed", "no column's name"))
