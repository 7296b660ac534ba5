"""Expanded size of the pages of a Parquet file, from their headers, before decompression.

Libraries allocate the size in a page's header, regardless of the metadata at the end of the file.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pyarrow.parquet as pq

from hydro.io.readers.expansion import LEAST, NUMBER, Expansion

_EXPANDED, _STORED = 2, 3
"""Fields of a page header: its expanded and its stored size [bytes]."""
_KINDS = {5: "values", 7: "dictionary", 8: "values"}
"""Fields of a page header that describe values, a dictionary, or values of the second version."""
_COUNT = 1
"""Field of these with the number of values."""
_SMALL_TEXT = LEAST / 8
"""Size of text below which its exact expanded size is not computed [bytes]."""
_PLAIN, _PLAIN_LENGTHS = 0, 6
"""Encodings of text that store every character in the page."""


def count(file: pq.ParquetFile, content: memoryview, expansion: Expansion) -> None:
    """Add the size of a Parquet file's columns after decompression to a counter, without decompressing them.

    A number counts `NUMBER` bytes, also where the file stores a repeated value once; text counts its
    characters.

    Args:
        file: The file.
        content: Its bytes.
        expansion: Counter of decompressed bytes, with its limit.

    Raises:
        DataError: The count exceeds its limit.
    """
    whole = 0
    texts: list[tuple[int, Any, int]] = []
    for group in range(file.metadata.num_row_groups):
        described = file.metadata.row_group(group)
        for place in range(described.num_columns):
            column = described.column(place)
            pages = list(_pages(content, column))
            values = max(column.num_values, described.num_rows, sum(page.values for page in pages))
            whole += max(NUMBER * values, sum(page.expanded for page in pages))
            if "BYTE_ARRAY" in column.physical_type and not all(page.plain for page in pages):
                texts.append((group, column, max(page.expanded for page in pages)))
    expansion.add(whole)
    for group, column, longest in texts:
        _count_text(file, group, column, longest, expansion)


def _count_text(file: pq.ParquetFile, group: int, column: Any, longest: int, expansion: Expansion) -> None:
    """Add to `expansion` the size of a text column of a row group that stores repeated texts once.

    A large column is decoded some rows at a time, without keeping them.

    Args:
        file: Parquet file.
        group: Number of the row group.
        column: Metadata of the column in this group.
        longest: Upper bound of the length of a text [bytes].
        expansion: Count of expanded bytes, with its limit.
    """
    if column.num_values * longest <= _SMALL_TEXT:
        expansion.add(column.num_values * longest)
        return
    rows = max(int(_SMALL_TEXT / longest), 1)
    for batch in file.iter_batches(rows, row_groups=[group], columns=[column.path_in_schema]):
        expansion.add(batch.nbytes)


@dataclass(frozen=True)
class _Page:
    """Page of a column: its expanded size, its number of values, and whether its text has no repetition."""

    expanded: int
    values: int
    plain: bool


def _pages(content: memoryview, column: Any) -> Iterator[_Page]:
    """Yield the pages of a column in one row group, up to the first invalid header."""
    start = column.data_page_offset
    if column.has_dictionary_page and 0 < column.dictionary_page_offset < start:
        start = column.dictionary_page_offset
    end = start + column.total_compressed_size
    while start < end:
        try:
            header, start = _struct(content, start)
        except (ValueError, IndexError, RecursionError):
            return
        kind = next((field for field in _KINDS if field in header), None)
        about = header[kind] if kind is not None else {}
        stored, expanded = _whole(header, _STORED, -1), _whole(header, _EXPANDED, -1)
        if stored < 0 or expanded < 0:
            return
        start += stored
        held = kind is not None and _KINDS[kind] == "values"
        encoding = _whole(about, 4 if kind == 8 else 2, -1)
        plain = not held or encoding in (_PLAIN, _PLAIN_LENGTHS)
        yield _Page(expanded, _whole(about, _COUNT, 0) if held else 0, plain)


def _whole(fields: Any, number: int, missing: int) -> int:
    """Return a whole number of a Thrift structure; `missing` if a damaged file has another value there."""
    value = fields.get(number) if isinstance(fields, dict) else None
    return value if isinstance(value, int) and not isinstance(value, bool) else missing


def _struct(content: memoryview, place: int) -> tuple[dict[int, Any], int]:
    """Return the fields of a Thrift compact structure by number, and the index after it."""
    found: dict[int, Any] = {}
    field = 0
    while head := content[place]:
        place += 1
        if head >> 4:
            field += head >> 4
        else:
            field, place = _integer(content, place)
        found[field], place = _value(content, place, head & 15)
    return found, place + 1


def _value(content: memoryview, place: int, kind: int) -> tuple[Any, int]:
    """Return a Thrift value, or None for a type that is only skipped, and the index after it."""
    if kind in (1, 2):
        return kind == 1, place
    if kind == 3:
        return None, place + 1
    if kind in (4, 5, 6):
        return _integer(content, place)
    if kind == 7:
        return None, place + 8
    if kind == 8:
        length, place = _varint(content, place)
        return None, place + length
    if kind in (9, 10):
        size, kind, place = content[place] >> 4, content[place] & 15, place + 1
        if size == 15:
            size, place = _varint(content, place)
        for _ in range(size):
            _, place = _value(content, place, 3 if kind in (1, 2) else kind)
        return None, place
    if kind == 12:
        return _struct(content, place)
    raise ValueError("a page has no header")


def _integer(content: memoryview, place: int) -> tuple[int, int]:
    """Return the signed integer at an index of the content, and the index after it."""
    number, place = _varint(content, place)
    return (number >> 1) ^ -(number & 1), place


def _varint(content: memoryview, place: int) -> tuple[int, int]:
    """Return the integer of seven bits per byte at an index of the content, and the index after it."""
    number = shift = 0
    while True:
        byte = content[place]
        number |= (byte & 127) << shift
        place, shift = place + 1, shift + 7
        if byte < 128:
            return number, place
        if shift > 63:
            raise ValueError("a page has no header")
