"""Reader of a ROS 1 bag that reads the index of one chunk at a time.

The library's reader lists every message of a bag before it yields the first, at about 170 bytes each.  That
is more than the numbers of a message.  A bag is a sequence of chunks of about a megabyte, each with an index.
"""

from __future__ import annotations

import os
import struct
from collections import defaultdict
from collections.abc import Collection, Iterator
from functools import partial
from typing import Any

from hydro.io.readers.compressed import unpacked
from hydro.io.readers.expansion import Expansion

_HEAD = 55
"""Bytes of an index record before its entries; the last four state the size of the entries."""


def by_chunk(expansion: Expansion) -> type[Any]:
    """Return a subclass of `rosbags.rosbag1.Reader` that reads one chunk at a time, with a limit on bytes.

    Args:
        expansion: Count of the file's decompressed bytes, with its limit.
    """
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import Header, IndexData

    class Placed(IndexData):  # type: ignore[misc]
        """Place of a message, ordered by offset: times fall where a simulator's clock restarts."""

        def __lt__(self, other: Any) -> bool:
            return bool(self.offset < other.offset)

    class ByChunk(Reader):  # type: ignore[misc]
        """Reader that yields messages chunk by chunk, in the order in which they were written."""

        connections: list[Any]
        _opening = False

        def open(self) -> None:
            """Read the connections and chunks of the bag."""
            self._opening = True
            super().open()
            self._opening = False
            counts: dict[int, int] = defaultdict(int)
            for info in self.chunk_infos:
                for number, count in info.connection_counts.items():
                    counts[number] += count
            self.connections = [each._replace(msgcount=counts[each.id]) for each in self.connections]

        def read_chunk(self) -> Any:
            """Read the header of a chunk; its contents are decompressed up to the limit."""
            place = self.bio.tell()
            header = Header.read(self.bio)
            form, size = header.get_string("compression"), header.get_uint32("size")
            self.bio.seek(place)
            unpack = partial(unpacked, form=form, stated=size, expansion=expansion)
            return super().read_chunk()._replace(decompressor=unpack)

        def read_index_data(self, pos: int, indexes: dict[int, list[Any]]) -> None:
            """Read an index record, or skip it while the bag is opened."""
            if self._opening:
                (size,) = struct.unpack_from("<L", self.bio.read(_HEAD), _HEAD - 4)
                self.bio.seek(size, os.SEEK_CUR)
            else:
                super().read_index_data(pos, indexes)

        def messages(
            self, connections: Collection[Any] = (), start: int | None = None, stop: int | None = None
        ) -> Iterator[tuple[Any, int, bytes]]:
            """Yield connection, time of receipt [ns] and bytes of the messages of some connections."""
            wanted = {each.id for each in connections or self.connections}
            for info in sorted(self.chunk_infos, key=lambda each: each.pos):
                if wanted.isdisjoint(info.connection_counts):
                    continue
                chunk = self.chunks[info.pos]
                self.bio.seek(chunk.datapos + chunk.datasize)
                found: dict[int, list[Any]] = defaultdict(list)
                for _ in info.connection_counts:
                    self.read_index_data(info.pos, found)
                self.indexes = {
                    each.id: sorted(Placed(*place) for place in found[each.id]) for each in self.connections
                }
                yield from super().messages(connections, start, stop)

    return ByChunk
