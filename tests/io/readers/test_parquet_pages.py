"""Headers of Parquet pages: what is not wanted of them is passed over to the byte."""

from __future__ import annotations

import pytest

from hydro.io.readers.parquet_pages import _struct

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
