"""Messages that are compressed one by one, as `ros2 bag record --compression-mode message` does."""

from __future__ import annotations

ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of a frame of zstd."""
LARGEST = 1 << 28
"""Bytes that one message may decompress to: more than an image or a cloud has, and less than a machine."""


def decompressed(raw: bytes) -> bytes:
    """Decompress a message.

    Raises:
        ValueError: it declares more than `LARGEST` bytes, or is damaged.
    """
    import zstandard

    if zstandard.frame_content_size(raw) > LARGEST:
        raise ValueError(f"a message of more than {LARGEST:,} bytes")
    return zstandard.ZstdDecompressor().decompress(raw, max_output_size=LARGEST)
