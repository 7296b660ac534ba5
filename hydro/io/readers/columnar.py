"""Reader of Parquet: typed columns, including durations, lists and structs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq

from hydro.core.errors import DataError, shown
from hydro.io.readers.expansion import Expansion
from hydro.io.readers.messages import DEEPEST, LONGEST, Options, Selection
from hydro.io.readers.parquet_pages import count


def parquet(path: Path, selection: Selection, options: Options) -> pl.DataFrame:
    """Return all columns of a Parquet file; structs become `name.field`, lists `name[0]` and so on.

    Raises:
        DataError: The file is damaged.
    """
    try:
        content = path.read_bytes()
        with pq.ParquetFile(pa.BufferReader(content)) as file:
            count(file, memoryview(content), Expansion(options.name, len(content)))
        frame = pl.read_parquet(content)
    except (pa.ArrowException, pl.exceptions.PolarsError, OSError) as error:
        reason = str(error).splitlines()[0]
        raise DataError(
            f"{options.name}: this Parquet file is damaged ({reason}): write or copy it again"
        ) from error
    if not any(dtype.is_nested() for dtype in frame.dtypes):
        return frame
    found = {part.name: part for column in frame for part in _flat(column, options, 0)}
    return pl.DataFrame(found)


def _flat(column: pl.Series, options: Options, depth: int) -> Iterator[pl.Series]:
    """Yield the columns in a nested column; a list longer than `LONGEST` is skipped with a note."""
    dtype = column.dtype
    if not dtype.is_nested():
        yield column
    elif depth > DEEPEST:
        return
    elif isinstance(dtype, pl.Struct):
        for field in dtype.fields:
            part = column.struct.field(field.name)
            yield from _flat(part.alias(f"{column.name}.{field.name}"), options, depth + 1)
    else:
        lists = column.arr.to_list() if isinstance(dtype, pl.Array) else column
        longest = int(lists.list.len().max() or 0)  # type: ignore[arg-type]
        if longest > LONGEST:
            options.notes.append(
                f"{shown(column.name)} holds up to {longest:,} elements a row and is not read "
                f"(at most {LONGEST})"
            )
            return
        for place in range(longest):
            part = lists.list.get(place, null_on_oob=True)
            yield from _flat(part.alias(f"{column.name}[{place}]"), options, depth + 1)
