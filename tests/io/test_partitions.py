"""A data set as a folder of sessions: what is read of it and when, and all that can be wrong with it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tables import raw

from hydro.core.errors import DataError
from hydro.io import partitions, provenance, table


def write(folder: Path, frame: pl.DataFrame, kind: str = "raw", **how: object) -> Path:
    """Each session of a table to its own file."""
    for (name,), part in frame.group_by("session", maintain_order=True):
        target = partitions.place(folder, str(name))
        target.parent.mkdir(parents=True, exist_ok=True)
        table.write(table.make(kind, part, stage="import", **how), target)
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write(tmp_path / "dives", raw())


def refused(folder: Path) -> str:
    with pytest.raises(DataError) as caught:
        table.read(folder, "raw")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_folder_reads_as_the_one_table_it_was_made_of(folder):
    whole, one = table.read(folder, "raw"), table.make("raw", raw(), stage="import")
    assert whole.frame.equals(one.frame)
    assert whole.provenance.content == one.provenance.content
    assert whole.provenance.stage == "import", "made alike, they are as one table of that stage"


def test_sessions_come_sorted_by_name_whatever_was_written_first(tmp_path):
    folder = write(tmp_path, raw(sessions=("b", "a", "c", "B")))
    assert table.read(folder).frame["session"].unique(maintain_order=True).to_list() == ["B", "a", "b", "c"]


@given(name=st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=30))
def test_any_name_of_a_session_is_one_folder_and_comes_back(name, tmp_path_factory):
    folder = tmp_path_factory.mktemp("named")
    target = partitions.place(folder, name)
    assert target.parent.parent == folder
    target.parent.mkdir()
    assert partitions.sessions(folder) == [name]


def test_polars_reads_the_layout_as_hive_partitions(tmp_path):
    names = ("a b", "ü/x=1", "7")
    write(tmp_path, raw(rows=42, sessions=names))
    read = pl.scan_parquet(tmp_path, hive_schema={"session": pl.String}).select("session").collect()
    assert set(read["session"]) == set(names)


def test_no_row_is_read_before_it_is_wanted(folder):
    """Footers alone tell what a dataset is: with every page of the data spoilt it opens, and t is not u."""
    data = partitions.opened(folder)
    assert [(part.session, part.rows) for part in data.parts] == [("turn-1", 20), ("turn-2", 20)]
    plan = data.scan().select("t", "u").explain()
    assert "PROJECT 2/" in plan
    path = data.parts[1].path
    content = bytearray(path.read_bytes())
    footer = int.from_bytes(content[-8:-4], "little") + 8
    content[4 : len(content) - footer] = bytes(len(content) - footer - 4)
    path.write_bytes(content)
    assert len(partitions.opened(folder).parts) == 2
    assert table.read_part(data.parts[0]).frame.height == 20
    assert str(path) in refused(folder)


def test_nulls_are_known_from_the_footer(tmp_path):
    sparse = raw().with_columns(u=pl.when(pl.int_range(pl.len()) % 2 == 0).then("u"))
    data = partitions.opened(write(tmp_path, sparse))
    assert [part.nulls for part in data.parts] == [{"u"}, {"u"}]
    assert [part.nulls for part in partitions.opened(write(tmp_path / "full", raw())).parts] == [set()] * 2


def _another(folder: Path, frame: pl.DataFrame, kind: str = "raw") -> None:
    frame = frame.with_columns(session=pl.lit("turn-9"))
    write(folder, frame.filter(pl.int_range(pl.len()) < 20), kind)


def _empty(folder: Path) -> None:
    for part in partitions.opened(folder).parts:
        part.path.unlink()
        part.path.parent.rmdir()
    (folder / "other").mkdir()


def _foreign(folder: Path, frame: pl.DataFrame, session: str = "turn-3") -> None:
    target = partitions.place(folder, session)
    target.parent.mkdir()
    frame.write_parquet(target)


ONE = raw(rows=20, sessions=("turn-3",))
BROKEN: dict[str, tuple[Callable[[Path], object], str]] = {
    "a column more": (lambda f: _another(f, raw(thrusters=4)), "cmd_4 (none, float32)"),
    "another type": (
        lambda f: _another(f, raw().with_columns(pl.col("u").cast(pl.Float64))),
        "u (float32, float64)",
    ),
    "a column missing": (lambda f: _foreign(f, ONE.drop("w")), "column w [m/s] is missing"),
    "a table of another kind": (
        lambda f: _foreign(f, pl.DataFrame({"model": ["a"], "value": [1.0]})),
        "missing: a raw table needs them",
    ),
    "an empty file": (lambda f: partitions.place(f, "turn-1").write_bytes(b""), "damaged"),
    "no Parquet": (lambda f: partitions.place(f, "turn-1").write_text("session,t\n" * 9), "damaged"),
    "no file": (lambda f: partitions.place(f, "turn-1").unlink(), "a part is called part.parquet"),
    "a folder for a file": (
        lambda f: (partitions.place(f, "turn-1").unlink(), partitions.place(f, "turn-1").mkdir()),
        "turn-1",
    ),
    "rows of another session": (lambda f: _foreign(f, ONE, "turn-4"), "its folder says turn-4"),
    "no rows": (lambda f: _foreign(f, ONE.clear()), "no rows"),
    "no sessions": (_empty, "this is a folder"),
}


@pytest.mark.parametrize(("breaks", "words"), BROKEN.values(), ids=BROKEN)
def test_what_is_wrong_with_a_folder_is_one_line(folder, breaks, words):
    breaks(folder)
    assert words in refused(folder)


def test_a_dataset_is_refused_as_what_it_is_not(folder, tmp_path):
    with pytest.raises(DataError, match="a raw table, but this needs labels"):
        table.read(folder, "labels")
    with pytest.raises(DataError, match="no sessions in this folder"):
        partitions.opened(tmp_path / "dives" / "session=turn-1")
    with pytest.raises(DataError, match="no such folder"):
        partitions.opened(tmp_path / "nothing")


def test_tables_that_were_not_made_alike_are_not_one(folder):
    """Labels of which some leave out what others do not would teach a network both."""
    frame = raw()
    rng = np.random.default_rng(0)
    from hydro.io import schema

    extra = [name for name in schema.load("labels").columns(frame.columns) if name not in frame.columns]
    labels = frame.with_columns(
        pl.Series(name, rng.normal(size=frame.height).astype(np.float32)) for name in extra
    )
    target = folder.parent / "labels"
    for session, subtract in (("turn-1", "inertia"), ("turn-2", "effects")):
        part = labels.filter(pl.col("session") == session)
        write(target, part, "labels", parameters={"subtract": subtract})
    with pytest.raises(DataError, match="turn-1 and turn-2 have different provenance"):
        table.read(target, "labels")
    write(target, labels, "labels", parameters={"subtract": "effects"})
    whole = table.read(target, "labels")
    assert provenance.parameters_of(whole.provenance, "import") == {"subtract": "effects"}
