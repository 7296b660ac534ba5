"""Decompression that stops at a limit: of messages, of the chunks of a bag, and of whole files."""

from __future__ import annotations

import bz2
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from hydro.io.readers.expansion import Expansion

ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of a frame of zstd."""
_DENSEST = (1 << 17) / 4
"""Bytes that zstd can make of one: a block of 128 KiB is at least four bytes."""
_STEP = 1 << 20
"""Bytes that are decompressed at a time where their number is not known."""


def unzstd(raw: bytes, expansion: Expansion) -> bytes:
    """Decompress a frame of zstd.  A size that it states is held to by the library.

    Raises:
        DataError: it expands beyond the limit.
        ValueError: it states more bytes than it can have.
        zstandard.ZstdError: it is damaged, or has another size than it states.
    """
    import zstandard

    stated = zstandard.frame_content_size(raw)
    if stated > _DENSEST * len(raw):
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
    """Decompress a chunk of a bag.

    Args:
        raw: The chunk.
        form: Its compression: `zstd`, `lz4` or `bz2`; anything else is none.
        stated: Bytes that it has, by its header.
        expansion: The count of its file.

    Raises:
        DataError: it expands beyond the limit.
        ValueError: it has more bytes than its header states, or is cut short.
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
    """Decompress a file into another.

    Raises:
        DataError: it expands beyond the limit.
    """
    import zstandard

    with path.open("rb") as file, target.open("wb") as out:
        reader = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
        while part := reader.read(_STEP):
            expansion.add(len(part))
            out.write(part)


def count_zlib(file: BinaryIO, length: int, expansion: Expansion) -> None:
    """Count what the next `length` bytes of a file expand to, without keeping it.

    Raises:
        DataError: they expand beyond the limit.
        zlib.error: they are damaged.
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
