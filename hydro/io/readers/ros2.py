"""ROS 2 recordings in SQLite, by `rosbags`, including compressed files or messages."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from hydro.io.readers import mcap_file
from hydro.io.readers.compressed import unzstd_file
from hydro.io.readers.expansion import Expansion
from hydro.io.readers.messages import Item, Options, Selection
from hydro.io.readers.ros import Definitions, messages_of

_METADATA = "metadata.yaml"


def sqlite(path: Path, selection: Selection, options: Options) -> Iterator[Item]:
    """Yield the messages of a ROS 2 recording in SQLite, each with its topic and time of receipt [s].

    The recording is a `.db3` file, or a folder with `metadata.yaml`.
    """
    from rosbags.rosbag2 import Reader

    expansion = Expansion.of(options.name, path)
    with tempfile.TemporaryDirectory() as folder:
        if path.is_dir():
            storage, path = _uncompressed(path, Path(folder), expansion), Path(folder)
            if storage == "mcap":
                yield from mcap_file.messages(path, selection, options)
                return
        elif path.suffix != ".db3":  # the library goes by suffix
            link = Path(folder) / "log.db3"
            link.symlink_to(path.resolve())
            path = link
        with Reader(path) as reader:
            yield from messages_of(reader, Definitions(2, options.definitions), selection, options, expansion)


def _uncompressed(recording: Path, folder: Path, expansion: Expansion) -> str:
    """Copy a recording to another folder with uncompressed files; return the name of its storage format.

    Messages that are compressed one by one stay compressed but are declared plain; the decoder decompresses
    them.
    """
    from ruamel.yaml import YAML

    yaml = YAML(typ="safe")
    described = yaml.load(recording / _METADATA)
    about = described["rosbag2_bagfile_information"]
    whole = str(about.pop("compression_mode", "")).lower() == "file"
    about.pop("compression_format", None)
    names = [Path(each).name for each in about["relative_file_paths"]]
    about["relative_file_paths"] = [Path(name).stem if whole else name for name in names]
    for name, plain in zip(names, about["relative_file_paths"], strict=True):
        if whole:
            unzstd_file(recording / name, folder / plain, expansion)
        else:
            (folder / plain).symlink_to((recording / name).resolve())
    yaml.dump(described, folder / _METADATA)
    return str(about["storage_identifier"])
