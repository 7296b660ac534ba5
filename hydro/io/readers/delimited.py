"""CSV with commas, semicolons or tabs, and Parquet."""

from __future__ import annotations

from pathlib import Path

import polars as pl

from hydro.core.errors import DataError, shown
from hydro.io.readers.messages import Options, Selection

EMPTY = ("", "nan", "NaN", "NAN", "na", "NA", "n/a", "N/A", "null", "NULL", "None", "-")
"""What loggers write into a cell that holds nothing."""
_SEPARATORS = (",", ";", "\t")
_RECEIVED, _STAMP = "%time", "field.header.stamp"
"""Columns of `rostopic echo -p`, in nanoseconds."""


def csv(path: Path, selection: Selection, options: Options) -> pl.DataFrame:
    """All columns of a CSV as text, so that what is no number can be reported with its place.

    Of what `rostopic echo -p` wrote, `time` and `receive_time` [s] stand beside them, as of a bag.
    """
    return parse_csv(path.read_bytes(), options.name)


def parquet(path: Path, selection: Selection, options: Options) -> pl.DataFrame:
    """All columns of a Parquet file, with their types."""
    return parse_parquet(path.read_bytes(), options.name)


def parse_csv(content: bytes, name: str) -> pl.DataFrame:
    """The table in these bytes of text.

    Raises:
        DataError: they are no table, or name a column twice.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(
            f"{name}: not UTF-8 text (byte {error.start}): save the log as UTF-8, or as Parquet"
        ) from error
    first = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    separator = max(_SEPARATORS, key=first.count)
    names = [part.strip().strip('"') for part in first.split(separator)]
    if len(names) < 2 or not all(character.isprintable() or character == "\t" for character in first):
        raise DataError(f"{name}: not a table: its first line should name columns, separated by commas")
    if twice := sorted({column for column in names if names.count(column) > 1}):
        raise DataError(f"{name}: column {shown(twice[0])} appears twice: rename or drop one")
    try:
        frame = pl.read_csv(
            text.encode(),
            separator=separator,
            comment_prefix="#",
            infer_schema=False,
            null_values=list(EMPTY),
        )
    except (pl.exceptions.PolarsError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise DataError(
            f"{name}: not a table of comma-separated values ({reason}): check its lines"
        ) from error
    return _with_times(frame.rename(dict(zip(frame.columns, names, strict=True))))


def _with_times(frame: pl.DataFrame) -> pl.DataFrame:
    """The table of `rostopic echo -p` with its clocks in seconds; any other as it is."""
    if _RECEIVED not in frame.columns or {"time", "receive_time"} & set(frame.columns):
        return frame
    seconds = {
        name: frame[name].cast(pl.Int64, strict=False).cast(pl.Float64) * 1e-9
        for name in (_RECEIVED, _STAMP)
        if name in frame.columns
    }
    received = seconds[_RECEIVED]
    stamped = seconds.get(_STAMP, received)
    time = stamped.zip_with((stamped > 0.0).fill_null(False), received)
    return frame.with_columns(time.alias("time"), received.alias("receive_time"))


def parse_parquet(content: bytes, name: str) -> pl.DataFrame:
    """The table in these bytes of Parquet.

    Raises:
        DataError: they are damaged.
    """
    try:
        return pl.read_parquet(content)
    except (pl.exceptions.PolarsError, OSError) as error:
        reason = str(error).splitlines()[0]
        raise DataError(f"{name}: this Parquet file is damaged ({reason}): write or copy it again") from error
