"""Arrays of numpy (`.npz`) and MATLAB (`.mat`, version 5): columns `name`, or `name[1]` if several."""

from __future__ import annotations

import struct
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from hydro.core.errors import DataError, shown
from hydro.io.readers import clocked
from hydro.io.readers.compressed import count_zlib
from hydro.io.readers.expansion import NUMBER, Expansion
from hydro.io.readers.messages import DEEPEST, LONGEST, Options, Selection

_MAT_HEADER = 128
"""Bytes before the first element of a `.mat`; the last two state the byte order."""
_COMPRESSED = 15
"""Type number of a compressed element of a `.mat`."""


def npz(path: Path, selection: Selection, options: Options) -> pl.DataFrame:
    """Return the arrays of a `.npz` as a table."""
    expansion = Expansion.of(options.name, path)
    with zipfile.ZipFile(path) as archive:
        expansion.add(sum(entry.file_size for entry in archive.infolist()))
        _check_sizes(archive, options.name)
    with np.load(path, allow_pickle=False) as file:
        found = {}
        for name in file.files:
            try:
                found[name] = file[name]
            except ValueError as error:
                if "allow_pickle" not in str(error):
                    raise
                options.notes.append(f"{shown(name)} holds Python objects and is not read")
    return table(found, selection, options, expansion)


def _check_sizes(archive: zipfile.ZipFile, name: str) -> None:
    """Refuse an archive whose arrays declare more than it contains: numpy would allocate it first."""
    for entry in archive.infolist():
        with archive.open(entry) as stream:
            version = np.lib.format.read_magic(stream)
            read = (
                np.lib.format.read_array_header_1_0
                if version == (1, 0)
                else np.lib.format.read_array_header_2_0
            )
            shape, _, dtype = read(stream)
            if not dtype.hasobject and np.prod(shape, dtype=float) * dtype.itemsize > entry.file_size:
                raise DataError(f"{name}: {shown(entry.filename)} is cut short: write or copy the file again")


def mat(path: Path, selection: Selection, options: Options) -> pl.DataFrame:
    """Return the arrays of a `.mat` of version 5 (`save -v7`, older) as a table; structs as `name.field`."""
    from scipy.io import loadmat

    expansion = Expansion.of(options.name, path)
    _count_elements(path, expansion)
    found = loadmat(path, simplify_cells=True)
    named = {name: each for name, each in found.items() if not name.startswith("__")}
    return table(named, selection, options, expansion)


def _count_elements(path: Path, expansion: Expansion) -> None:
    """Count the expanded size of the compressed elements of a `.mat`; its stated sizes are not trusted."""
    with path.open("rb") as file:
        order = "<" if file.read(_MAT_HEADER)[-2:] == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, length = struct.unpack(f"{order}2I", tag)
            end = file.tell() + length
            if kind == _COMPRESSED:
                count_zlib(file, length, expansion)
            file.seek(end)


def table(
    named: Mapping[str, Any], selection: Selection, options: Options, expansion: Expansion
) -> pl.DataFrame:
    """Return named arrays as the columns of one table.

    Arrays of several lengths, each with an array of times, get their own rows, sorted by time.  Otherwise the
    arrays of the most frequent length are used; of equally frequent lengths, the longest.

    Args:
        named: Arrays, and mappings of arrays, by name.
        selection: Wanted columns.
        options: Name of the file for errors; receives a note on arrays that are left out.
        expansion: Count of the file's expanded bytes, with its limit.

    Raises:
        DataError: There is no array of numbers, the wanted arrays have different lengths, or they exceed the
            limit as float64.
    """
    arrays = dict(_numeric_arrays(named, "", 0))
    expansion.add(sum(max(NUMBER * each.size - each.nbytes, 0) for each in arrays.values()))
    columns = {name: each for key, array in arrays.items() for name, each in _columns(key, array)}
    if (timed := clocked.table(columns, selection, options)) is not None:
        return timed
    if selection.columns is not None:
        columns = {name: each for name, each in columns.items() if name in selection.columns}
        lengths = {len(each): name for name, each in columns.items()}
        if len(lengths) > 1:
            told = " and ".join(f"{name} has {count:,}" for count, name in lengths.items())
            raise DataError(f"{options.name}: {told} rows: name arrays of one length in the map")
    if not columns:
        if selection.columns is not None:
            return pl.DataFrame()
        raise DataError(
            f"{options.name}: no array of numbers with two rows or more: save the log's columns as arrays"
        )
    counts = Counter(len(each) for each in columns.values())
    rows = max(counts, key=lambda count: (counts[count], count))
    others = [name for name, each in columns.items() if len(each) != rows]
    if others:
        options.notes.append(f"left out, because they do not have {rows:,} rows: {', '.join(others[:8])}")
    return pl.DataFrame({name: each for name, each in columns.items() if len(each) == rows})


def _numeric_arrays(value: Any, name: str, depth: int) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Yield every array of numbers with its name, those in structs as `struct.field`."""
    if isinstance(value, Mapping) and depth <= DEEPEST:
        for key, part in value.items():
            yield from _numeric_arrays(part, f"{name}.{key}" if name else str(key), depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.size > 1:
        yield name, value


def _columns(name: str, array: np.ndarray[Any, Any]) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Yield the columns of an array with their names; the rows are the longer side of the array."""
    flat = np.squeeze(array)
    if flat.ndim == 1:
        yield name, np.ascontiguousarray(flat)
    elif flat.ndim == 2:
        tall = flat if flat.shape[0] >= flat.shape[1] else flat.T
        if tall.shape[1] <= LONGEST:
            yield from (
                (f"{name}[{place}]", np.ascontiguousarray(tall[:, place])) for place in range(tall.shape[1])
            )
