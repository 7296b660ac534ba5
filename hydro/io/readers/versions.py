"""Messages whose type has several versions: the one that fits a topic's messages is found by trying."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

Read = Callable[[Any], Any]


class Versions:
    """Decoder of a topic that takes the first version of its type that its messages fit.

    Args:
        every: Yields a decoder for each version, the likeliest first; asked for only as long as none fits.
    """

    def __init__(self, every: Iterator[Read]) -> None:
        self._every = every
        self._tried: list[Read] = []
        self._found: Read | None = None

    def __call__(self, raw: Any) -> Any:
        """Decode a message.

        Raises:
            Exception: whatever the likeliest version raises, where none fits.
        """
        if self._found is not None:
            return self._found(raw)
        first: Exception | None = None
        for read in self._candidates():
            try:
                message = read(raw)
            except Exception as error:
                first = first or error
                continue
            self._found = read
            return message
        raise first or ValueError("its type has no definition")

    def _candidates(self) -> Iterator[Read]:
        yield from list(self._tried)
        for read in self._every:
            self._tried.append(read)
            yield read
