"""Headers of Parquet pages: what is not wanted of them is passed over to the byte."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from hydro.io.readers.parquet_pages import _Page, _pages, _struct

INTEGERS, LIST = 5, 9


@pytest.mark.parametrize("size", [0, 1, 14, 15, 16, 127, 128, 300])
def test_what_stands_behind_a_list_of_any_length_is_read(size: int):
    """Thrift's compact protocol: up to 14 entries are counted in the list's head, more in bytes behind it."""
    if size < 15:
        head = bytes([size << 4 | INTEGERS])
    else:
        count = [size & 127 | 128, size >> 7] if size > 127 else [size]
        head = bytes([15 << 4 | INTEGERS, *count])
    first = bytes([1 << 4 | LIST]) + head + bytes([2]) * size
    content = first + bytes([1 << 4 | INTEGERS, 14, 0])  # 7, whose sign is the last bit
    assert _struct(memoryview(content), 0) == ({1: None, 2: 7}, len(content))


def pages(header: bytes) -> list[_Page]:
    """The pages of a column with this header, and five bytes of data."""
    content = memoryview(header + bytes(5))
    column = SimpleNamespace(
        data_page_offset=0, has_dictionary_page=False, total_compressed_size=len(content)
    )
    return list(_pages(content, column))


def test_a_field_of_a_damaged_header_is_no_number():
    """Field 1: kind of the page; 2: its expanded size; 3: its stored size; 5: a structure with its values."""
    number, byte, boolean = bytes([1 << 4 | INTEGERS, 10]), bytes([1 << 4 | 3, 10]), bytes([1 << 4 | 1])
    values = bytes([2 << 4 | 12]) + number + bytes([0])
    assert pages(number + number + number + values + bytes([0])) == [_Page(5, 5, False)]
    for wrong in (byte, boolean):
        assert pages(number + wrong + number + values + bytes([0])) == []
        assert pages(number + number + wrong + values + bytes([0])) == []
    uncounted = bytes([2 << 4 | 12]) + byte + bytes([0])
    assert pages(number + number + number + uncounted + bytes([0])) == [_Page(5, 0, False)]
