"""Small files of every format whose contents are zeros by the gigabyte, made without holding these."""

from __future__ import annotations

import bz2
import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

PIECE = 1 << 20
"""Bytes that are compressed at a time."""


def zeros(size: int, head: bytes = b"") -> Iterator[bytes]:
    """Yield a head and zeros after it, `size` bytes of these."""
    yield head
    block = bytes(PIECE)
    for start in range(0, size, PIECE):
        yield block[: min(PIECE, size - start)]


def zstd(pieces: Iterator[bytes], size: int = -1) -> bytes:
    """Return a frame of zstd, which declares a size where one is given."""
    import zstandard

    packer = zstandard.ZstdCompressor(level=1).compressobj(size=size)
    return b"".join(packer.compress(each) for each in pieces) + packer.flush()


def lz4(pieces: Iterator[bytes]) -> bytes:
    """Return a frame of LZ4."""
    from lz4.frame import LZ4FrameCompressor

    packer = LZ4FrameCompressor()
    return packer.begin() + b"".join(packer.compress(each) for each in pieces) + packer.flush()


def bzip2(pieces: Iterator[bytes]) -> bytes:
    """Return a stream of bzip2."""
    packer = bz2.BZ2Compressor(9)
    return b"".join(packer.compress(each) for each in pieces) + packer.flush()


def mcap(
    path: Path, size: int, form: str = "zstd", declared: int | None = None, encoding: str = "json"
) -> Path:
    """Write an MCAP whose only chunk has one message of zeros.

    Args:
        path: Where to.
        size: Bytes of the message.
        form: Compression of the chunk.
        declared: Bytes that the chunk's header says it has; the truth by default.
        encoding: Of the message.
    """
    from mcap.data_stream import RecordBuilder
    from mcap.records import Channel, Chunk, DataEnd, Footer, Header, Schema
    from mcap.writer import MCAP0_MAGIC

    def record(each: object) -> bytes:
        builder = RecordBuilder()
        each.write(builder)  # type: ignore[attr-defined]
        return builder.end()

    described = record(Schema(data=b"uint8[] data", encoding="ros2msg", id=1, name="test_msgs/msg/Bytes"))
    described += record(Channel(id=1, topic="/pad", message_encoding=encoding, metadata={}, schema_id=1))
    head = described + struct.pack("<BQHIQQ", 5, 22 + size, 1, 0, 10**9, 10**9)
    whole = len(head) + size
    packed = {"zstd": lambda pieces: zstd(pieces, whole), "lz4": lz4}[form](zeros(size, head))
    told = whole if declared is None else declared
    chunk = Chunk(
        form, packed, message_end_time=0, message_start_time=0, uncompressed_crc=0, uncompressed_size=told
    )
    end = record(DataEnd(data_section_crc=0)) + record(
        Footer(summary_start=0, summary_offset_start=0, summary_crc=0)
    )
    path.write_bytes(MCAP0_MAGIC + record(Header(profile="", library="")) + record(chunk) + end + MCAP0_MAGIC)
    return path


def mcap_messages(path: Path, size: int, declares: bool = True) -> Path:
    """Write an MCAP of messages that are compressed one by one, ten of them."""
    from mcap.writer import CompressionType, Writer

    length = size // 10
    head = b"\x00\x01\x00\x00" + struct.pack("<I", length - 8)
    packed = zstd(zeros(length - 8, head), length if declares else -1)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        kind = writer.register_schema("test_msgs/msg/Bytes", "ros2msg", b"uint8[] data")
        channel = writer.register_channel("/pad", "cdr", kind)
        for place in range(10):
            writer.add_message(channel, place * 10**8, packed, place * 10**8)
        writer.finish()
    return path


def bag(path: Path, size: int, form: str = "bz2") -> Path:
    """Write a ROS 1 bag whose only chunk has one message of zeros."""

    def header(**fields: bytes) -> bytes:
        parts = (f"{name}=".encode() + value for name, value in fields.items())
        body = b"".join(struct.pack("<I", len(each)) + each for each in parts)
        return struct.pack("<I", len(body)) + body

    def number(value: int) -> bytes:
        return struct.pack("<I", value)

    def data(content: bytes) -> bytes:
        return number(len(content)) + content

    when = struct.pack("<II", 1, 0)
    described = header(
        topic=b"/pad", type=b"std_msgs/String", md5sum=b"0" * 32, message_definition=b"string data\n"
    )
    connection = header(op=b"\x07", conn=number(0), topic=b"/pad") + data(described[4:])
    message = header(op=b"\x02", conn=number(0), time=when) + number(size) + number(size - 4)
    pack = {"bz2": bzip2, "lz4": lz4}[form]
    packed = pack(zeros(size - 4, connection + message))
    whole = len(connection) + len(message) + size - 4
    chunk = header(op=b"\x05", compression=form.encode(), size=number(whole)) + data(packed)
    index = header(op=b"\x04", ver=number(1), conn=number(0), count=number(1))
    index += data(when + number(len(connection)))
    magic = b"#ROSBAG V2.0\n"
    start = len(magic) + 4096
    place = start + len(chunk) + len(index)
    info = header(
        op=b"\x06",
        ver=number(1),
        chunk_pos=struct.pack("<Q", start),
        start_time=when,
        end_time=when,
        count=number(1),
    )
    info += data(number(0) + number(1))
    top = header(op=b"\x03", index_pos=struct.pack("<Q", place), conn_count=number(1), chunk_count=number(1))
    top += data(b" " * (4096 - len(top) - 4))
    path.write_bytes(magic + top + chunk + index + connection + info)
    return path


def npz(path: Path, size: int) -> Path:
    """Write a numpy archive with an array of zeros."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (size // 8,)}
    )
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.npy", "w", force_zip64=True) as file,
    ):
        for each in zeros(size, head.getvalue()):
            file.write(each)
    return path


def mat(path: Path, size: int) -> Path:
    """Write a MATLAB file with a column of zeros."""
    body = struct.pack("<4I", 6, 8, 6, 0) + struct.pack("<4i", 5, 8, size // 8, 1)
    body += struct.pack("<2I", 1, 1) + b"a".ljust(8, b"\0") + struct.pack("<2I", 9, size)
    packer = zlib.compressobj(9)
    head = struct.pack("<2I", 14, len(body) + size) + body
    packed = b"".join(packer.compress(each) for each in zeros(size, head)) + packer.flush()
    start = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<HH", 0x100, 0x4D49)
    path.write_bytes(start + struct.pack("<2I", 15, len(packed)) + packed)
    return path


def parquet(path: Path, size: int) -> Path:
    """Write a Parquet file with a column of one number, in a dictionary, again and again."""
    rows = PIECE * 8
    block = pa.table({"t": np.zeros(rows)})
    with pq.ParquetWriter(path, block.schema, compression="zstd") as writer:
        for _ in range(max(size // 8 // rows, 1)):
            writer.write_table(block, row_group_size=rows)
    return path


def parquet_page(path: Path, size: int) -> Path:
    """Write a Parquet file with one text of zeros, whose end says that its page has only 50 bytes."""
    text = pa.array(["0" * size])
    sink = io.BytesIO()
    pq.write_table(
        pa.table({"t": [0.0], "session": text}),
        sink,
        compression="zstd",
        use_dictionary=False,
        write_statistics=False,
    )
    content = sink.getvalue()
    stated = pq.read_metadata(io.BytesIO(content)).row_group(0).column(1).total_uncompressed_size
    end = len(content) - 8 - int.from_bytes(content[-8:-4], "little")
    lie = _varint(50, len(_varint(stated)))
    path.write_bytes(content[:end] + content[end:].replace(_varint(stated), lie))
    return path


def _varint(number: int, length: int = 1) -> bytes:
    """Return a number as Thrift writes it, in at least `length` bytes."""
    left, out = 2 * number, b""
    while left > 127 or len(out) < length - 1:
        out, left = out + bytes([left & 127 | 128]), left >> 7
    return out + bytes([left])


def parquet_text(path: Path, size: int) -> Path:
    """Write a Parquet file with a long text, in a dictionary, again and again."""
    text = "0" * (PIECE // 2)
    rows = size // len(text)
    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), pa.array([text]))
    pq.write_table(
        pa.table({"t": np.arange(float(rows)), "session": column}),
        path,
        compression="zstd",
        store_schema=False,
    )
    return path


def db3_messages(path: Path, size: int) -> Path:
    """Write a ROS 2 recording in SQLite whose messages are compressed one by one, ten of them."""
    import sqlite3

    length = size // 10
    head = b"\x00\x01\x00\x00" + struct.pack("<I", length - 8)
    packed = zstd(zeros(length - 8, head))
    database = sqlite3.connect(path)
    database.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,"
        " offered_qos_profiles TEXT);"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
        "INSERT INTO topics VALUES (1, '/pad', 'std_msgs/msg/String', 'cdr', '');"
    )
    for place in range(10):
        database.execute("INSERT INTO messages VALUES (NULL, 1, ?, ?)", (place * 10**8, packed))
    database.commit()
    database.close()
    return path


def folder(path: Path, size: int, mode: str) -> Path:
    """Write a ROS 2 recording's folder that is compressed message by message, or as a whole file."""
    path.mkdir()
    inner = db3_messages(path / "log.db3", size if mode == "MESSAGE" else 1000)
    name = inner.name
    if mode == "FILE":
        content = inner.read_bytes()
        inner.unlink()
        (path / "log.db3.zstd").write_bytes(zstd(zeros(size, content)))
        name = "log.db3.zstd"
    topic = {
        "topic_metadata": {
            "name": "/pad",
            "type": "std_msgs/msg/String",
            "serialization_format": "cdr",
            "offered_qos_profiles": "",
        },
        "message_count": 10,
    }
    about = {
        "version": 4,
        "storage_identifier": "sqlite3",
        "relative_file_paths": [name],
        "duration": {"nanoseconds": 10**9},
        "starting_time": {"nanoseconds_since_epoch": 0},
        "message_count": 10,
        "topics_with_message_count": [topic],
        "compression_format": "zstd",
        "compression_mode": mode,
    }
    (path / "metadata.yaml").write_text(json.dumps({"rosbag2_bagfile_information": about}))
    return path


def ragged(path: Path, size: int) -> Path:
    """Write a CSV with many columns and nothing but the first cell of each row."""
    side = int((size / 16) ** 0.5)
    path.write_text(",".join(f"c{each}" for each in range(side)) + "\n" + "1\n" * side)
    return path


def ulog(path: Path, size: int) -> Path:
    """Write a ULog whose types are made of types, each with a hundred of the next."""

    def message(letter: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(letter)) + body

    depth = max(1, round(np.log(size) / np.log(100.0)))
    parts = [b"ULog\x01\x12\x35\x01" + bytes(8), message("B", bytes(40))]
    parts += [message("F", f"t{each}:t{each + 1}[100] x;".encode()) for each in range(1, depth)]
    parts += [
        message("F", f"t{depth}:uint8_t x;".encode()),
        message("F", b"t0:uint64_t timestamp;t1[100] x;"),
    ]
    parts += [
        message("A", struct.pack("<BH", 0, 1) + b"t0"),
        message("D", struct.pack("<HQ", 1, 0) + bytes(8)),
    ]
    path.write_bytes(b"".join(parts))
    return path


def json_lists(path: Path, size: int) -> Path:
    """Write an MCAP with one message of JSON: empty lists in a list, which take more than their text."""
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD, chunk_size=size)
        writer.start()
        channel = writer.register_channel("/pad", "json", 0)
        count = size // 64
        writer.add_message(channel, 0, b"[" + b"[]," * count + b"[]]", 0)
        writer.finish()
    return path


BOMBS: dict[str, Callable[[Path, int], Path]] = {
    "chunk-zstd.mcap": mcap,
    "chunk-lz4.mcap": lambda path, size: mcap(path, size, "lz4"),
    "lying-zstd.mcap": lambda path, size: mcap(path, size, "zstd", 1000),
    "lying-lz4.mcap": lambda path, size: mcap(path, size, "lz4", 1000),
    "messages.mcap": mcap_messages,
    "messages-silent.mcap": lambda path, size: mcap_messages(path, size, declares=False),
    "bz2.bag": bag,
    "lz4.bag": lambda path, size: bag(path, size, "lz4"),
    "a.npz": npz,
    "a.mat": mat,
    "numbers.parquet": parquet,
    "text.parquet": parquet_text,
    "page.parquet": parquet_page,
    "messages.db3": db3_messages,
    "message-mode": lambda path, size: folder(path, size, "MESSAGE"),
    "file-mode": lambda path, size: folder(path, size, "FILE"),
    "ragged.csv": ragged,
    "nested.ulg": ulog,
}
"""Every bomb, by a file's name: what writes it, with about so many bytes of contents."""
