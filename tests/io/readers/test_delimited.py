"""Tables of text as programs and loggers really write them, and Git LFS pointers in their place."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from hydro.core.errors import DataError
from hydro.io import log, logmap
from hydro.io.sessions import sessions


def read(content: str | bytes) -> log.Log:
    return log.read(io.BytesIO(content.encode() if isinstance(content, str) else content))


def numbers(found: log.Log, name: str) -> list[float]:
    return log.numbers(found, name, "rates").tolist()


# Headers and lines


@pytest.mark.parametrize(
    ("header", "name"),
    [('t,"a, port",b', "a, port"), ('t, "a, port", b', "a, port"), ('"t","a; b",c', "a; b"),
     ('t,"a\nport",b', "a\nport"), ('t,"a ""x""",b', 'a "x')],
)  # fmt: skip
def test_a_quoted_name_may_hold_separators_quotes_and_line_feeds(header, name):
    found = read(f"{header}\n0,1,2\n1,3,4\n")
    assert found.table.width == 3
    assert numbers(found, found.table.columns[1]) == [1.0, 3.0]
    assert found.table.columns[1].startswith(name)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_may_end_as_on_any_system(end):
    found = read(end.join(["# logger", "t,x", "0,1.5", "1,2.5", ""]))
    assert numbers(found, "x") == [1.5, 2.5]


def test_utf_16_of_a_spreadsheet():
    assert numbers(read("t;x\n0;1,5\n".encode("utf-16")), "x") == [1.5]


def test_more_fields_than_names_are_no_damage():
    with pytest.raises(DataError, match="not a table of comma-separated values") as caught:
        read('t,"a, b"\n1,2,3\n')
    assert "damaged" not in str(caught.value)


def test_a_last_row_that_is_cut_off_is_left_out_with_a_note():
    found = read("t,x,y\n0,1.5,2.5\n1,2")
    assert numbers(found, "x") == [1.5]
    assert found.notes == ("the last row is cut off after 2 of 3 cells and is left out",)
    whole = read("t,x,y\n0,1.5,2.5\n1,2,3")
    assert numbers(whole, "y") == [2.5, 3.0]
    assert whole.notes == ()


# NUL bytes


@pytest.mark.parametrize(
    "content",
    [b't,x,s\n0,1,"\0\0"\n1,2,a\n', b"t,x,s\n0,1,a\n1,2,b\n" + bytes(5000), bytes(9) + b"t,x\n0,1\n1,2\n"],
)
def test_nul_bytes_in_cells_and_tails_are_left_out_with_a_note(content):
    found = read(content)
    assert numbers(found, "x") == [1.0, 2.0]
    assert [f"{content.count(0):,} NUL bytes are left out" in note for note in found.notes] == [True]


# Decimal commas


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas_where_the_separator_is_another(separator):
    rows = [
        ["t", "x", "n", "note"],
        ["0,0", "-1,25", "1", "a,b"],
        ["0,1", "2,5e-1", "2", "1.5,7"],
        ["0,2", "", "3", ""],
    ]
    found = read("\n".join(separator.join(row) for row in rows))
    assert numbers(found, "x")[:2] == [-1.25, 0.25]
    assert numbers(found, "t") == [0.0, 0.1, 0.2]
    assert numbers(found, "n") == [1.0, 2.0, 3.0]
    assert found.notes == ("decimal commas are read as points in t, x",)
    assert found.table["note"].to_list()[0] == "a,b"


def test_commas_of_thousands_beside_points_are_not_touched():
    found = read("t;x\n0;1,234\n1;1.5\n")
    with pytest.raises(DataError, match="1,234"):
        log.numbers(found, "x", "rates")


MAP = '[time]\ncolumn = "t"\nunit = "iso"\n[rates]\ncolumns = ["p", "q", "r"]\n[commands]\ncolumns = ["c"]\n'


def test_iso_timestamps_with_a_comma():
    """ISO 8601 allows it, and Python's logging writes it."""
    text = "t;p;q;r;c\n" + "\n".join(
        f"2026-11-26 10:00:{stamp};0;0;0;0" for stamp in ("00,000", "00,500", "02,250")
    )
    (found,) = sessions(read(text), logmap.parse(MAP))
    np.testing.assert_array_equal(found.t, [0.0, 0.5, 2.25])


# Units behind numbers


def test_a_unit_at_the_end_of_cells_is_left_out_with_a_note():
    found = read("t,v,a,s\n0s,0.5V,1 m/s^2,3a\n1s,-1e-1V,,3b\n2s,2V,3 m/s^2,3a\n")
    assert numbers(found, "v") == [0.5, -0.1, 2.0]
    assert numbers(found, "t") == [0.0, 1.0, 2.0]
    np.testing.assert_array_equal(numbers(found, "a"), [1.0, np.nan, 3.0])
    assert found.notes == (
        "units at the end of cells are left out, check them against the map: t [s], v [V], a [m/s^2]",
    )
    assert found.table["s"].to_list() == ["3a", "3b", "3a"], "different endings are no unit"


def test_a_decimal_comma_before_a_unit():
    assert numbers(read("t;v\n0;0,5 V\n1;1,5 V\n"), "v") == [0.5, 1.5]


def test_mixed_units_are_refused():
    with pytest.raises(DataError, match="column v must be numbers"):
        log.numbers(read("t,v\n0,500mV\n1,1V\n"), "v", "voltage")


# Git LFS


def test_a_pointer_of_git_lfs_says_what_to_run(tmp_path: Path):
    pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1234\n"
    folder = tmp_path / "dive"
    folder.mkdir()
    (folder / "dive_0.db3").write_bytes(pointer)
    for path, name in ((folder, "dive: dive_0.db3"), (folder / "dive_0.db3", "dive_0.db3")):
        with pytest.raises(DataError, match=rf"{name}: this is a pointer of Git LFS.* `git lfs pull`"):
            log.read(path)
