"""Decoder of messages whose type has several versions: the first version that fits is used."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

Read = Callable[[Any], Any]


class Versions:
    """Decoder for messages of a type that has several versions: it uses the first version that fits.

    Args:
        every: Yields a decoder for each version, the most likely first, and only until one fits.
    """

    def __init__(self, every: Iterator[Read]) -> None:
        self._every = every
        self._tried: list[Read] = []
        self._found: Read | None = None

    def __call__(self, raw: Any) -> Any:
        """Decode a message.

        Raises:
            Exception: Error of the most likely version, if none fits.
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
