"""ROS 1 bags, by `rosbags`; messages and their definitions, also for ROS 2 and MCAP."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from hydro.core.errors import DataError
from hydro.io.readers.chunks import by_chunk
from hydro.io.readers.compressed import ZSTD, unzstd
from hydro.io.readers.damage import BoundedPath
from hydro.io.readers.expansion import Expansion
from hydro.io.readers.messages import Item, Options, Selection, Topic, number
from hydro.io.readers.ros_definitions import BUILT_IN
from hydro.io.readers.versions import Versions

_NANO, _MICRO = 1e9, 1e6
_EVERY = 4096
"""Number of messages between two reports of progress."""


class Definitions:
    """Definitions of ROS message types: from a log, or else from a folder, or else from the ROS distribution.

    Args:
        ros: Version of ROS, 1 or 2, whose distribution has the types that a log does not describe.
        folder: Folder with `.msg` files, or None.

    Raises:
        DataError: The folder does not exist, or a file in it is not a message definition.
    """

    def __init__(self, ros: int, folder: Path | None) -> None:
        from rosbags.typesys import Stores, get_typestore

        known = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.LATEST)
        self._types: dict[str, Any] = dict(known.fielddefs)
        self._ros = ros
        self._store: Any = get_typestore(Stores.EMPTY)
        self._broken: dict[str, str] = {}
        self._described: set[str] = set()
        if folder is not None:
            self._add_types(_from_folder(folder))

    def _add_types(self, types: dict[str, Any]) -> None:
        self._types.update(types)
        self._described.update(types)

    def add(self, kind: str, text: str, form: str) -> None:
        """Add the definition of a message type from a log; an invalid one is remembered as broken.

        Args:
            kind: Name of the type.
            text: Definition.
            form: Language of the definition, `msg` or `idl`.
        """
        from rosbags.typesys import get_types_from_idl, get_types_from_msg

        try:
            if form == "msg":
                self._add_types(get_types_from_msg(text, kind))
            else:
                for part in re.split(r"^=+\n", text, flags=re.MULTILINE):
                    body = part.partition("\n")[2] if part.startswith("IDL: ") else part
                    if body.strip():
                        self._add_types(get_types_from_idl(body))
        except Exception as error:
            self._broken[kind] = str(error).partition("\n")[0]

    def decoder(self, kind: str) -> tuple[Callable[[bytes], Any] | None, str]:
        """Return the decoder of a message type, or None and the reason why there is no decoder.

        Args:
            kind: Name of the type.

        Returns:
            Function from the bytes of a message to the message, and an empty text; or None and the reason.
        """
        undescribed = self._ros == 2 and kind not in self._described
        if undescribed and (kind in BUILT_IN or kind in self._types):
            return Versions(self._versions(kind)), ""
        if kind in self._broken:
            return None, "its definition cannot be read: give --msg DIR with its .msg files"
        needed: dict[str, None] = {}
        if missing := _missing(kind, self._types, needed):
            return None, f"no definition of {missing}: give --msg DIR with its .msg files"
        return self._reader(self._store, kind, self._types, needed), ""

    def _versions(self, kind: str) -> Iterator[Callable[[bytes], Any]]:
        """Yield decoders of a type that the log does not describe: built in, or of every ROS distribution."""
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        def distributions() -> Iterator[dict[str, Any]]:
            yield self._types
            for name in reversed([each for each in Stores if each.value.startswith("ros2_")]):
                yield {**get_typestore(name).fielddefs, **{own: self._types[own] for own in self._described}}

        def built_in() -> Iterator[dict[str, Any]]:
            for text in BUILT_IN.get(kind, ()):
                yield {**self._types, **get_types_from_msg(text, kind)}

        seen = []
        for types in chain(built_in(), distributions()):
            needed: dict[str, None] = {}
            if _missing(kind, types, needed):
                continue
            tree = {name: types[name] for name in needed}
            if tree not in seen:
                seen.append(tree)
                yield self._reader(get_typestore(Stores.EMPTY), kind, types, needed)

    def _reader(
        self, store: Any, kind: str, types: dict[str, Any], needed: Iterable[str]
    ) -> Callable[[bytes], Any]:
        """Return the decoder of a type, and register all types that it contains in a store."""
        if new := {name: types[name] for name in needed if name not in store.fielddefs}:
            store.register(new)
        read = store.deserialize_ros1 if self._ros == 1 else store.deserialize_cdr
        return partial(_decode, read, kind)

    def stamp(self, kind: str) -> Callable[[Any], float | None]:
        """Return a function from a message of a type to its time stamp [s], None without a stamp.

        Args:
            kind: Name of the type.
        """
        if kind in BUILT_IN and kind not in self._described:
            text = BUILT_IN[kind][0]
            names = [line.split()[-1] for line in text.splitlines()]
        else:
            names = [name for name, _ in self._types[kind][1]] if kind in self._types else []
        if "header" in names:
            return _header_stamp
        if kind.startswith("px4_msgs/") and "timestamp" in names:
            return lambda message: message.timestamp / _MICRO
        return (lambda message: number(message.stamp)) if "stamp" in names else (lambda message: None)


def _missing(kind: str, types: dict[str, Any], needed: dict[str, None]) -> str:
    """Add a type and all types that it contains to `needed`; return the first without definition, or "".

    Args:
        kind: Name of the type.
        types: Known definitions by name.
        needed: Names so far.
    """
    if kind in needed:
        return ""
    if kind not in types:
        return kind
    needed[kind] = None
    for _, described in types[kind][1]:
        while isinstance(described[1], tuple) and not isinstance(described[1][0], str):
            described = described[1][0]
        if isinstance(described[1], str) and (missing := _missing(described[1], types, needed)):
            return missing
    return ""


def _decode(read: Callable[[bytes, str], Any], kind: str, raw: bytes) -> Any:
    return read(raw, kind)


def _decode_plain(decode: Callable[[bytes], Any], expansion: Expansion, raw: bytes) -> Any:
    """Decode a message that may be compressed; no ROS message begins with the magic bytes of zstd."""
    return decode(unzstd(raw, expansion) if raw[:4] == ZSTD else raw)


def _header_stamp(message: Any) -> float | None:
    return number(getattr(message.header, "stamp", None))


def _from_folder(folder: Path) -> dict[str, Any]:
    """Return the types of all `.msg` files under a folder, named after the folder of their package."""
    from rosbags.typesys import get_types_from_msg

    files = sorted(folder.rglob("*.msg"))
    if not files:
        raise DataError(f"{folder}: no .msg file in this folder: name the one that holds the definitions")
    found: dict[str, Any] = {}
    for file in files:
        package = file.resolve().parent
        package = package.parent if package.name == "msg" else package
        try:
            found |= get_types_from_msg(file.read_text(), f"{package.name}/msg/{file.stem}")
        except Exception as error:
            reason = str(error).partition("\n")[0]
            raise DataError(f"{file}: not a message definition ({reason}): correct it") from error
    return found


def bag(path: Path, selection: Selection, options: Options) -> Iterator[Item]:
    """Yield the messages of a ROS 1 bag, each with its topic and time of receipt [s].

    Within each chunk of the bag, messages are in order of receipt.
    """
    expansion = Expansion.of(options.name, path)
    with by_chunk(expansion)(BoundedPath(path)) as reader:
        yield from messages_of(reader, Definitions(1, options.definitions), selection, options, expansion)


def messages_of(
    reader: Any, known: Definitions, selection: Selection, options: Options, expansion: Expansion
) -> Iterator[Item]:
    """Yield the wanted messages of an open reader, each with its topic and time of receipt [s].

    Args:
        reader: Open reader of `rosbags`.
        known: Message types, to which those of the log are added.
        selection: Wanted topics and fields.
        options: Options; its progress is called.
        expansion: Count of the file's expanded bytes, with its limit.
    """
    for each in reader.connections:
        if each.msgdef.data:
            known.add(each.msgtype, each.msgdef.data, each.msgdef.format.name.lower())
    topics = {each.id: topic(each.topic, each.msgtype, known, expansion) for each in reader.connections}
    wanted = [each for each in reader.connections if selection.takes(each.topic)]
    if not wanted:
        return
    total = sum(each.msgcount for each in wanted)
    for done, (source, received, raw) in enumerate(reader.messages(connections=wanted)):
        yield topics[source.id], received / _NANO, raw
        if done % _EVERY == 0:
            options.progress(done / max(total, 1))


def topic(name: str, kind: str, known: Definitions, expansion: Expansion) -> Topic:
    """Return a topic of ROS messages; its `decode` is None if one of its types is not known.

    Args:
        name: Name of the topic.
        kind: Name of the message type.
        known: Message types.
        expansion: Count of the file's expanded bytes, with its limit.
    """
    decode, why = known.decoder(kind)
    decode = decode and partial(_decode_plain, decode, expansion)
    return Topic(name, kind, decode, known.stamp(kind), unread=why)
