"""Logs in CSV and Parquet, and map files: what is read, and one line for everything that is wrong."""

from __future__ import annotations

import io
from datetime import UTC, datetime
from pathlib import Path

import logs
import numpy as np
import polars as pl
import pytest

from hydro.core.errors import DataError
from hydro.core.guessing.aliases import guess
from hydro.io import log, logmap, mapdraft
from hydro.io.sessions import sessions

MAP = logs.PLAIN_TEXT


def table(rows: int = 5) -> pl.DataFrame:
    return logs.raw(1.0).head(rows).drop("session")


def read(content: str | bytes) -> log.Log:
    return log.read(io.BytesIO(content.encode() if isinstance(content, str) else content))


def parted(frame: pl.DataFrame, changes: str = "", **columns) -> list:
    meaning = logmap.parse(changes or MAP)
    return sessions(read(frame.with_columns(**columns).write_csv()), meaning)


def refused(call, *arguments) -> str:
    with pytest.raises(DataError) as caught:
        call(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# Reading


@pytest.mark.parametrize(
    ("cells", "numbers"),
    [
        ([" 1.5", "n/a"], True),  # what is no number further down is told by its row
        ([None, "2e3", "x"], True),
        (["n/a", "1.5"], False),
        (["  ", "1.5"], False),
        ([None, None], False),
    ],
)
def test_a_column_of_text_holds_numbers_if_its_first_entry_is_one(cells, numbers):
    assert log.numeric(pl.Series(cells, dtype=pl.String)) is numbers


def test_a_typed_column_holds_numbers_by_its_type():
    numbers = (pl.Int8, pl.Float32, pl.Boolean, pl.Duration)
    others = (pl.Date, pl.Time, pl.Datetime, pl.Binary)
    assert all(log.numeric(pl.Series([None], dtype=dtype)) for dtype in numbers)
    assert not any(log.numeric(pl.Series([None], dtype=dtype)) for dtype in others)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("bom", [b"", b"\xef\xbb\xbf"])
def test_a_csv_with_any_separator_and_comments(separator, bom):
    text = "# made by a logger\n" + table().write_csv(separator=separator)
    (found,) = sessions(read(bom + text.encode()), logmap.parse(MAP))
    np.testing.assert_array_equal(found.t, table()["t"])
    np.testing.assert_array_equal(found.columns["u"], table()["u"])


def test_parquet_is_read_as_csv_is():
    sink = io.BytesIO()
    table().with_columns(pl.col("u").cast(pl.Float32)).write_parquet(sink)
    (found,) = sessions(read(sink.getvalue()), logmap.parse(MAP))
    np.testing.assert_allclose(found.columns["u"], table()["u"], rtol=1e-6)


@pytest.mark.parametrize("nothing", ["", "nan", " NaN ", "NA", "null", "-", "inf"])
def test_cells_that_hold_nothing_are_empty(nothing):
    frame = table().with_columns(u=pl.Series(["0.5", nothing, " 0.25", "1e-1", "7"]))
    (found,) = parted(frame)
    np.testing.assert_array_equal(found.columns["u"], [0.5, np.nan, 0.25, 0.1, 7.0])


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"", "stdin: empty file"),
        (b"t,x\n", "stdin: no rows after the header"),
        ("t,x\n1,ü\n".encode("latin-1"), "stdin: not UTF-8 text (byte 6): save the log as UTF-8"),
        (b"nothing here\nat all\n", "stdin: not a table: its first line should name columns"),
        (b"t,x,x\n1,2,3\n", "stdin: column x appears twice"),
        (b"t,x\n1,2,3\n", "stdin: not a table of comma-separated values"),
        (b"PAR1 and no more", "stdin: this Parquet file is damaged"),
        (b"\x00\x01\x02,\x03\n1,2", "stdin: not a table"),
    ],
)
def test_what_is_no_table_is_refused(content, line):
    assert refused(read, content).startswith(line)


def test_a_missing_file_is_told(tmp_path):
    assert "no such file" in refused(log.read, tmp_path / "none.csv")


# Times


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns", "iso"])
def test_clocks_of_every_unit_and_any_epoch_count_from_the_session_start(unit):
    t = np.array([0.0, 0.02, 0.04, 0.06, 0.5])
    frame = table().with_columns(t=logs.clock(t, unit))
    (found,) = parted(frame, MAP.replace('"t"', f'"t"\nunit = "{unit}"'))
    np.testing.assert_allclose(found.t, t, atol=1e-9)


def test_timestamps_with_zones_and_without_and_typed_ones():
    texts = [
        "2025-06-01T12:00:00Z",
        "2025-06-01 12:00:00.5",
        "2025-06-01T14:00:01+02:00",
        "2025-06-01T07:30:02-0430",
    ]
    (found,) = parted(table(4), MAP.replace('"t"', '"t"\nunit = "iso"'), t=pl.Series(texts))
    np.testing.assert_array_equal(found.t, [0.0, 0.5, 1.0, 2.0])
    sink = io.BytesIO()
    typed = pl.Series([datetime(2025, 6, 1, 12, 0, second, tzinfo=UTC) for second in range(4)])
    table(4).with_columns(t=typed).write_parquet(sink)
    (found,) = sessions(read(sink.getvalue()), logmap.parse(MAP))
    np.testing.assert_array_equal(found.t, [0.0, 1.0, 2.0, 3.0])


def test_rows_without_a_time_are_left_out():
    (found,) = parted(table(), t=pl.Series([0.0, None, 0.2, None, 0.3]))
    np.testing.assert_array_equal(found.t, [0.0, 0.2, 0.3])
    assert len(found.columns["u"]) == 3


# Sessions


def test_sessions_by_column_by_name_and_by_gaps():
    frame = table().with_columns(
        run=pl.Series(["b", "b", "a", "a", "a"]), t=pl.Series([5.0, 6.0, 1.0, 2.0, 9.0])
    )
    found = parted(frame, MAP + '[session]\ncolumn = "run"')
    assert [(each.name, each.t.tolist()) for each in found] == [("b", [0.0, 1.0]), ("a", [0.0, 1.0, 8.0])]
    found = parted(frame, MAP + '[session]\ncolumn = "run"\ngap = 5')
    assert [(each.name, len(each.t)) for each in found] == [("b", 2), ("a-1", 2), ("a-2", 1)]
    assert found[2].t.tolist() == [0.0]
    assert [each.name for each in parted(table(), MAP + '[session]\nname = "dive 7"')] == ["dive 7"]


# Columns that do not fit


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"u": pl.Series(["1", "fast", "2", "x", "3"])},
         "column u must be numbers, but 2 of 5 rows are not (first: row 2, 'fast'): correct the log or name "
         "another column in velocity"),
        ({"cmd_2": pl.Series(["1", "0", "off", "0", "0"])},
         "column cmd_2 must be numbers, but 1 of 5 rows is not"),
        ({"t": pl.Series(["0", "1", "2", "noon", "4"])}, "column t must be numbers, but 1 of 5 rows is not"),
        ({"t": pl.Series([0.0, 0.1, 0.05, 0.2, 0.15])},
         "column t goes backwards within session log in 2 of 5 rows (first: row 3, by 0.05 s): sort the log"),
        ({"t": pl.Series([None] * 5, dtype=pl.Float64)}, "column t holds no time"),
    ],
)  # fmt: skip
def test_columns_that_do_not_fit_are_told_with_their_first_row(changes, line):
    assert f"stdin: {line}" in refused(lambda: parted(table(), **changes))


def test_a_missing_column_is_told_with_its_place_in_the_map():
    line = refused(parted, table(), MAP.replace('"theta"', '"thata"'))
    assert line == "stdin: no column is called thata, which the map names in attitude: did you mean theta?"
    assert "session.column: it has t, x, y" in refused(
        parted, table(), MAP + '[session]\ncolumn = "Tauchgang"'
    )
    assert "no column is called ''" in refused(parted, table(), MAP.replace('"x"', '""'))


def test_numbers_where_timestamps_are_said_to_be():
    line = refused(parted, table(), MAP.replace('"t"', '"t"\nunit = "iso"'))
    assert "column t must be ISO timestamps such as 2025-06-01T12:00:00.25Z, but 5 of 5 rows are not" in line


# Maps


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('column = "t"', 'column = "t"\nunit = "min"',
         "time.unit: expected s or ms or us or ns or iso, got min"),
        ('column = "t"', 'colum = "t"', "time.colum: unknown key: did you mean column?"),
        ('column = "t"', "", "time.column: missing: add it"),
        ('column = "t"', 'column = "t"\nunits = "s"', "time.units: unknown key: did you mean unit?"),
        ('"x", "y", "z"]', '"x", "y", "z"]\nworld = "NEU"',
         "position.world: expected NED or ENU or NWU, got NEU"),
        ('"x", "y", "z"]', '"x", "y"]', "position: give three columns, or two and either depth or height"),
        ('"x", "y", "z"]', '"x", "y", "z"]\ndepth = "d"', "position: give three columns, or two"),
        ('"x", "y", "z"]', '"x", "y", 3]', "position.columns[2]: expected str | object, got int"),
        ('"u", "v", "w"]', '"u", "v", {column = "w", scale = 0.0}]',
         "velocity.columns[2].scale: must be finite and"),
        ('"x", "y", "z"]', '"x", "y", "x"]', "position: column x is named twice: name another for each axis"),
        ('"x", "y", "z"]', '"x", "y"]\ndepth = "y"', "position: column y is named twice"),
        ('"phi", "theta", "psi"]', '"psi", "theta", {column = "psi", scale = 2.0}]',
         "attitude: column psi is named twice"),
        ('"u", "v", "w"]', '"u", "v", {column = "w", sign = -1}]', "velocity.columns[2].sign: unknown key"),
        ('"u", "v", "w"]', '"u", "v"]', "velocity.columns: expected 3 columns, got 2"),
        ('"p", "q", "r"]', '"p", "q", "r"]\nunit = "rpm"', "rates.unit: expected rad/s or deg/s, got rpm"),
        ('columns = ["phi", "theta", "psi"]', "",
         "attitude: give either columns (roll, pitch, yaw) or quaternion"),
        ('columns = ["phi", "theta", "psi"]', 'quaternion = ["a", "b", "c"]',
         "attitude.quaternion: expected 4"),
        ('["cmd_1", "cmd_2"]', "[]", "commands.columns: name at least one column"),
        ('["cmd_1", "cmd_2"]', '["a"]\npwm = {min = 1900, max = 1100}',
         "commands.pwm: neutral must lie between"),
        ("[time]", "[[time]", "not valid TOML"),
        ("[rates]", '[session]\ncolumn = "a"\nname = "b"\n[rates]', "session: give either column or name"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_map_is_told_with_its_path(old, new, line):
    assert old in MAP
    told = refused(logmap.parse, MAP.replace(old, new), "map.toml")
    assert told.startswith(f"map.toml: {line}")


def test_a_map_may_leave_out_sensors_but_not_all():
    head, *blocks = MAP.split("\n[")
    rest = {block.partition("]")[0]: "\n[" + block for block in blocks}
    tables = {name: text for name, text in rest.items() if name in ("time", "commands", "session")}
    least = head + "".join(tables.values())
    assert logmap.parse(least + rest["rates"]).velocity is None
    assert "give at least one of position, attitude, velocity, rates" in refused(logmap.parse, least)
    along_world = least + rest["velocity"] + '\nframe = "ENU"'
    assert "velocity.frame: ENU needs an attitude" in refused(logmap.parse, along_world)


def test_maps_are_told_from_vehicle_files(datasets: Path):
    assert logmap.is_map(datasets / "logs" / "map.toml")
    assert not logmap.is_map(datasets / "stonefish" / "vehicle.toml")


def test_a_draft_is_a_map_that_says_what_was_guessed(tmp_path):
    names = ["time_ms", "roll_deg", "pitch_deg", "yaw_deg", *"xyzuvwpqr", "servo1_raw"]
    blocks = guess(names)
    (tmp_path / "map.toml").write_text(mapdraft.draft(blocks, names, "log.csv"))
    found = logmap.read(tmp_path / "map.toml")
    assert found == logmap.from_guess(blocks, names) or found.session.name == "log"
    assert found.attitude == logmap.from_guess(blocks, names).attitude
    assert (found.time.unit, found.commands.unit) == ("ms", "pwm")


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("log; touch x.csv", "# How `hydro import 'log; touch x.csv' --map THIS` reads that log."),
        ("a\nb", "# How `hydro import 'a\\nb' --map THIS` reads that log."),
    ],
)
def test_the_command_in_a_draft_names_any_file_as_one_word(name, line):
    names = ["time_ms", "roll_deg", "a\nevil = 1"]
    text = mapdraft.draft(guess(names), names, name)
    assert line in text.splitlines()
    assert "evil = 1" not in text.splitlines()


def test_a_draft_of_unknown_names_is_still_a_map_with_blanks():
    text = mapdraft.draft({}, ["a", "b"], "log.csv")
    assert "# The log has: a, b" in text
    assert logmap.parse(text).position.columns == ("", "", "")
    assert "the columns' names do not identify time, position" in refused(logmap.from_guess, {}, ["a", "b"])


def test_a_log_of_text_that_is_no_utf8_map(tmp_path):
    (tmp_path / "map.toml").write_bytes(b"# \xff\n")
    assert "not UTF-8 text" in refused(logmap.read, tmp_path / "map.toml")


def test_rows_of_a_csv_are_counted_from_one(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,u\n0.0,1\n0.1,fast\n0.2,3\n")
    found = log.read(path)
    assert found.row(1) == "row 2"
    with pytest.raises(DataError, match=r"1 of 3 rows is not \(first: row 2, 'fast'\)"):
        log.numbers(found, "u", "velocity")


# Rows that were written twice


def test_rows_that_were_written_twice_count_once():
    whole = logs.raw(1.0).drop("session").with_columns(q=pl.lit(None))
    twice = pl.concat([whole, whole]).sort("t", maintain_order=True)
    once, found = parted(whole)[0], parted(twice)[0]
    np.testing.assert_array_equal(found.t, once.t)
    for name, values in once.columns.items():
        np.testing.assert_array_equal(found.columns[name], values)
    assert (once.repeated, found.repeated) == (0, whole.height)


@pytest.mark.parametrize("column", ["u", "cmd_1"])
def test_rows_with_one_time_that_differ_are_all_kept(column):
    whole = logs.raw(1.0).drop("session")
    twice = pl.concat([whole, whole]).sort("t", maintain_order=True)
    changed = twice.with_columns(
        pl.when(pl.int_range(pl.len()) == 7).then(0.123).otherwise(column).alias(column)
    )
    found = parted(changed)[0]
    assert (len(found.t), found.repeated) == (2 * whole.height, 0)


def test_rows_with_one_time_and_no_value_are_kept():
    whole = table().with_columns(pl.lit(None, pl.Float64).alias(name) for name in ("u", "v"))
    empty = whole.with_columns(pl.lit(None, pl.Float64).alias(name) for name in whole.columns if name != "t")
    found = parted(pl.concat([whole, empty, empty]).sort("t", maintain_order=True))[0]
    assert (len(found.t), found.repeated) == (15, 0)
