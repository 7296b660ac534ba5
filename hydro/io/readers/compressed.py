"""Decompression with a limit: messages, chunks of a bag, and whole files."""

from __future__ import annotations

import bz2
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from hydro.io.readers.expansion import Expansion

ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of a zstd frame."""
_MAX_RATIO = (1 << 17) / 4
"""Maximum ratio of expansion of zstd: a block of 128 KiB has at least four bytes."""
_STEP = 1 << 20
"""Number of bytes per step of a decompression of unknown size."""


def unzstd(raw: bytes, expansion: Expansion) -> bytes:
    """Return the decompressed content of a zstd frame.

    If the frame states its size, the library enforces that size.

    Args:
        raw: The frame.
        expansion: Count of the file's expanded bytes, with its limit.

    Raises:
        DataError: The data expand beyond the limit.
        ValueError: The data state an impossible size.
        zstandard.ZstdError: The data are damaged, or differ in size from their header.
    """
    import zstandard

    stated = zstandard.frame_content_size(raw)
    if stated > _MAX_RATIO * len(raw):
        raise ValueError(f"a frame of {len(raw):,} bytes that states {stated:,}")
    if stated >= 0:
        expansion.add(stated)
        return zstandard.ZstdDecompressor().decompress(raw)
    parts = []
    with zstandard.ZstdDecompressor().stream_reader(raw) as reader:
        while part := reader.read(_STEP):
            expansion.add(len(part))
            parts.append(part)
    return b"".join(parts)


def unpacked(raw: bytes, form: str, stated: int, expansion: Expansion) -> bytes:
    """Return the decompressed content of a chunk of a bag.

    Args:
        raw: The chunk.
        form: Compression: `zstd`, `lz4` or `bz2`; anything else means none.
        stated: Expanded size in bytes, from the header.
        expansion: Count of the file's expanded bytes, with its limit.

    Raises:
        DataError: The data expand beyond the limit.
        ValueError: The data differ in size from their header, or are cut short.
    """
    if form == "zstd":
        return unzstd(raw, expansion)
    if form not in ("lz4", "bz2"):
        return raw
    from lz4.frame import LZ4FrameDecompressor

    expansion.add(stated)
    unpacker = LZ4FrameDecompressor() if form == "lz4" else bz2.BZ2Decompressor()
    content: bytes = unpacker.decompress(raw, max_length=stated + 1)
    if len(content) > stated or not unpacker.eof:
        raise ValueError(f"a chunk that has not the {stated:,} bytes which its header states")
    return content


def unzstd_file(path: Path, target: Path, expansion: Expansion) -> None:
    """Decompress the file `path` into the file `target`.

    Args:
        path: Compressed file.
        target: File to write.
        expansion: Count of the expanded bytes, with its limit.

    Raises:
        DataError: The data expand beyond the limit.
    """
    import zstandard

    with path.open("rb") as file, target.open("wb") as out:
        reader = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
        while part := reader.read(_STEP):
            expansion.add(len(part))
            out.write(part)


def count_zlib(file: BinaryIO, length: int, expansion: Expansion) -> None:
    """Add the expanded size of the next `length` bytes of a file to `expansion`, without keeping the bytes.

    Raises:
        DataError: The data expand beyond the limit.
        zlib.error: The data are damaged.
    """
    unpacker = zlib.decompressobj()
    for block in _blocks(file, length):
        rest = block
        while rest and not unpacker.eof:
            expansion.add(len(unpacker.decompress(rest, _STEP)))
            rest = unpacker.unconsumed_tail


def _blocks(file: BinaryIO, length: int) -> Iterator[bytes]:
    """Yield the next `length` bytes of a file, block by block."""
    while length > 0 and (block := file.read(min(length, _STEP))):
        length -= len(block)
        yield block
