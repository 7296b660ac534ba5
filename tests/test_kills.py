"""A command that is killed leaves nothing half-written, and makes the same bytes when it goes on."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from benchmarks import kills

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are sent as POSIX does")


@pytest.mark.parametrize(("name", "often"), [("import", 3), ("rl train", 1)])
def test_killed_and_gone_on(name: str, often: int) -> None:
    work = next(one for one in kills.works() if one.name == name)
    rows = list(kills.study(work, often, np.random.default_rng(7)))
    assert [row["fault"] for row in rows] == [""] * often


def test_every_long_command_is_killed() -> None:
    names = [work.name for work in kills.works()]
    assert names == [
        "import",
        "collect",
        "labels",
        "train",
        "fit",
        "explain",
        "track",
        "study",
        "rl train",
        "rl study",
    ]


def test_what_is_torn_or_other_is_seen(tmp_path: Path) -> None:
    """The checks can fail: a file cut short, one left unfinished, one with other bytes, one too many."""
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "vehicle.toml").write_text("name = 'a'\n")
    a, b = tmp_path / "a", tmp_path / "b"
    assert kills.different(a, b) == ""
    assert kills.broken(a) == ""
    (a / "raw.parquet").write_bytes(b"PAR1")
    (a / "checkpoint.pt").write_bytes(b"PK")
    assert kills.broken(a) == "checkpoint.pt, raw.parquet"
    assert kills.different(a, b) == "checkpoint.pt, raw.parquet"
    (b / "vehicle.toml").write_text("name = 'b'\n")
    assert "vehicle.toml" in kills.different(a, b)
    assert kills.unfinished(a / ".raw.parquet.0-1.tmp")


def test_a_failure_is_told(tmp_path: Path) -> None:
    ended, fault = kills.killed("labels none.parquet -o labels.parquet", tmp_path, 60.0, signal.SIGKILL)
    assert ended
    assert fault.startswith("exit 1: hydro: none.parquet")
