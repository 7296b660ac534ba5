"""Decoding of Parquet bytes with Arrow and polars; every failure is one line that names the file."""

from __future__ import annotations

import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq

from hydro.core.errors import DataError
from hydro.io.files import shown
from hydro.io.readers import parquet_pages
from hydro.io.readers.expansion import Expansion

MAGIC = b"PAR1"


def opened(content: bytes, name: str) -> pq.ParquetFile:
    """Return an open Parquet file, given its bytes in memory.

    Args:
        content: Bytes of the file.
        name: Name of the file in error messages.

    Raises:
        DataError: The bytes are not a Parquet file, or the file is incomplete or damaged.
    """
    if not content.startswith(MAGIC):
        raise DataError(f"{name}: not a Parquet file: convert it, with the columns of a raw table")
    if not content.endswith(MAGIC) or len(content) < 12:
        raise DataError(f"{name}: this Parquet file is cut short: write or copy it again")
    try:
        return pq.ParquetFile(pa.BufferReader(content))
    except UnicodeDecodeError as error:
        raise DataError(f"{name}: column names must be UTF-8 text: rename them ({error})") from error
    except (pa.ArrowException, OSError) as error:
        raise damaged(name, error) from error


def columns(file: pq.ParquetFile, name: str) -> dict[str, str]:
    """Return the storage type of every column by its name, such as `float32`.

    Raises:
        DataError: The file is damaged, or two columns have the same name.
    """
    try:
        fields = list(file.schema_arrow)
    except (pa.ArrowException, OSError) as error:
        raise damaged(name, error) from error
    names = [field.name for field in fields]
    twice = sorted({column for column in names if names.count(column) > 1})
    if twice:
        raise DataError(f"{name}: column {shown(twice[0])} appears twice: leave one out")
    return {field.name: stored_as(field.type) for field in fields}


def count(file: pq.ParquetFile, content: memoryview, name: str) -> None:
    """Check that the expanded size of a Parquet file is within the limit, before the file is decoded.

    Args:
        file: The file.
        content: Bytes of the file.
        name: Name of the file in error messages.

    Raises:
        DataError: The expanded size exceeds the limit (`io.readers.expansion`), or the file is damaged.
    """
    try:
        parquet_pages.count(file, content, Expansion(name, len(content)))
    except (pa.ArrowException, OSError) as error:
        raise damaged(name, error) from error


def stored_as(arrow: pa.DataType) -> str:
    """Return the name of an Arrow type in schema files, such as `float32`."""
    if pa.types.is_dictionary(arrow):
        return stored_as(arrow.value_type)
    if pa.types.is_string(arrow) or pa.types.is_large_string(arrow) or pa.types.is_string_view(arrow):
        return "string"
    if pa.types.is_list(arrow) or pa.types.is_large_list(arrow):
        return f"list<{stored_as(arrow.value_type)}>"
    return {"float": "float32", "double": "float64", "halffloat": "float16", "bool": "boolean"}.get(
        str(arrow), str(arrow)
    )


def decode(file: pq.ParquetFile, name: str) -> pl.DataFrame:
    """Return all rows as a polars table, without a copy of columns that Arrow holds in one piece.

    Args:
        file: Open Parquet file.
        name: Name of the file, for messages.

    Raises:
        DataError: The file is damaged, or a column contains text that is not UTF-8.
    """
    try:
        arrow = file.read()
    except (pa.ArrowException, OSError) as error:
        raise damaged(name, error) from error
    for column, values in zip(arrow.column_names, arrow.columns, strict=True):
        try:
            values.validate(full=True)
        except pa.ArrowException as error:
            raise DataError(
                f"{name}: {column} contains text that is not UTF-8: write it again ({error})"
            ) from error
    # Without field metadata: polars panics on unusual metadata.
    bare = pa.Table.from_arrays(arrow.columns, names=arrow.column_names)
    frame = pl.from_arrow(bare, rechunk=True)
    assert isinstance(frame, pl.DataFrame)
    return frame


def damaged(name: str, error: Exception) -> DataError:
    """Return (not raise) the error for a file that Arrow cannot decode.

    Args:
        name: Name of the file in the message.
        error: Exception of the library, whose first line is the reason.
    """
    reason = (str(error) or type(error).__name__).splitlines()[0]
    return DataError(f"{name}: this Parquet file is damaged ({reason}): write or copy it again")
