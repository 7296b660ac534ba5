"""Tables in Parquet: reading and writing with checks against the schema, and provenance."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
from msgspec import structs

from hydro.core.errors import DataError
from hydro.io import file_kind, parquet, partitions, provenance, schema, vehicle
from hydro.io.files import Source, name_of, read_bytes, shown, whole_file, write_bytes
from hydro.io.partitions import Dataset, Part
from hydro.io.provenance import Input, Provenance

ROWS_PER_GROUP = 131_072
"""Number of rows of a Parquet row group; constant, so that the same table has the same bytes."""


@dataclass(frozen=True)
class Artefact:
    """Table with provenance, checked against the schema of its kind.

    Attributes:
        kind: Kind of table, such as `raw` or `diagnosis`.
        frame: Rows of the table.
        provenance: Command, inputs and hashes from which the table was made; stored in the file's footer.
    """

    kind: str
    frame: pl.DataFrame
    provenance: Provenance

    def of_network(self, described: Mapping[str, Any]) -> Artefact:
        """Return a copy of a table of tensors with the description of their network in its footer.

        Args:
            described: Description by key; JSON values.
        """
        return replace(self, provenance=structs.replace(self.provenance, model=dict(described)))


def make(
    kind: str,
    frame: pl.DataFrame,
    *,
    stage: str,
    parameters: Mapping[str, Any] | None = None,
    seed: int | None = None,
    inputs: Sequence[Artefact] = (),
    vehicle_text: str | None = None,
) -> Artefact:
    """Return a table as an artefact: check the table, hash it, and record its provenance.

    Args:
        kind: Kind of table, one of `schema.KINDS`.
        frame: Table, its columns in any order; all-null columns, integers and missing optional columns are
            converted as by `conform`.
        stage: Command that made the table, such as `labels`.
        parameters: Parameters, besides inputs and seed, that determine the result; JSON values.
        seed: Seed of all random numbers.
        inputs: Artefacts from which the table was made.
        vehicle_text: Text of the vehicle file; by default the one text that the inputs have.

    Raises:
        DataError: The table breaks the schema of its kind.
    """
    rules = schema.suited(kind, frame)
    frame = rules.check(rules.conform(frame), kind)
    lineage = [artefact.provenance.as_input() for artefact in inputs]
    if vehicle_text is None:
        carried = {artefact.provenance.vehicle for artefact in inputs} - {None}
        vehicle_text = carried.pop() if len(carried) == 1 else None
    else:
        lineage.append(Input("vehicle", vehicle.vehicle_hash(vehicle.parse(vehicle_text))))
    record = Provenance(
        kind=kind,
        schema=rules.digest,
        content=provenance.content_hash(frame),
        stage=stage,
        parameters=dict(parameters or {}),
        seed=seed,
        package=provenance.package_version(),
        inputs=tuple(lineage),
        vehicle=vehicle_text,
    )
    return Artefact(kind, frame, record)


def conform(kind: str, frame: pl.DataFrame) -> pl.DataFrame:
    """Return a table in the schema's column order and types, as it would be read from its file.

    Args:
        kind: Kind of table, such as `raw`.
        frame: The table; not changed.

    Raises:
        DataError: There is no such kind.
    """
    return schema.suited(kind, frame).conform(frame)


def read(source: Source, kind: str | Sequence[str] | None = None) -> Artefact:
    """Read a table and check it against its schema.

    Args:
        source: Path of a Parquet file; or of a dataset's folder (`io.partitions`), whose sessions are
            concatenated, sorted by name; or a binary stream, read to its end.
        kind: Accepted kind or kinds of table; by default any.  A file without hydro's footer is read as the
            kind whose columns differ least.

    Returns:
        Artefact; columns in the schema's order, each contiguous.

    Raises:
        DataError: The file cannot be read, is of another kind, breaks its schema, expands beyond the limit
            (`io.readers.expansion`), or was changed after its footer was written.
        UsageError: The stream is a terminal.
    """
    name = name_of(source)
    wanted = (kind,) if isinstance(kind, str) else tuple(kind or schema.KINDS)
    if isinstance(source, str | Path) and partitions.is_dataset(source):
        return _read_dataset(partitions.opened(source, wanted))
    content = read_bytes(source)
    try:
        file = parquet.opened(content, name)
    except DataError as error:
        raise file_kind.explained(error, name, file_kind.RECORDING) from error
    columns = parquet.columns(file, name)
    footer = (file.metadata.metadata or {}).get(provenance.FOOTER_KEY)
    record = provenance.from_json(footer, name) if footer is not None else None
    kind = record.kind if record is not None else schema.fitting(wanted, columns)
    if kind not in wanted:
        needed = " or ".join(wanted)
        raise DataError(f"{name}: a {shown(kind)} table, but this needs {needed}: give another file")
    schema.with_columns(schema.versions(kind), columns).check_columns(columns, name)
    parquet.count(file, memoryview(content), name)
    frame = parquet.decode(file, name)
    rules = schema.suited(kind, frame)
    frame = rules.check(frame, name)
    digest = provenance.content_hash(frame)
    if record is None:
        return Artefact(kind, frame, Provenance(kind, rules.digest, digest))
    if digest != record.content:
        raise DataError(f"{name}: its rows do not match the hash in its footer: make the file again")
    return Artefact(kind, frame, record)


def read_part(part: Part) -> Artefact:
    """Return the table of one session of a dataset, read from its file.

    Raises:
        DataError: The file cannot be read, is of another kind, breaks its schema, expands beyond the limit,
            or was changed; or a row belongs to another session than the folder names.
    """
    artefact = read(part.path, part.kind)
    others = artefact.frame.filter(pl.col("session") != part.session)["session"]
    if others.len():
        raise DataError(
            f"{name_of(part.path)}: {others.len()} of {artefact.frame.height} rows are of session "
            f"{shown(others[0])}, but its folder says {shown(part.session)}: write each session to its own"
        )
    return artefact


def _read_dataset(dataset: Dataset) -> Artefact:
    """Return all sessions of a dataset as one table, with the stage of its parts if they agree.

    Raises:
        DataError: As for `read_part`; or parts of a derived kind, such as labels, have different provenance.
    """
    parts = [read_part(part) for part in dataset.parts]
    frame = pl.concat([part.frame for part in parts], rechunk=True)
    records = [part.provenance for part in parts]
    whole = Provenance(
        kind=dataset.kind,
        schema=schema.suited(dataset.kind, frame).digest,
        content=provenance.content_hash(frame),
        inputs=_unique(record.as_input() for record in records),
        vehicle=dataset.vehicle,
    )
    first = records[0]
    made = first.stage, first.parameters
    odd = [number for number, one in enumerate(records) if (one.stage, one.parameters) != made]
    if not odd and first.stage is not None:
        inputs = _unique(each for record in records for each in record.inputs)
        whole = structs.replace(whole, stage=first.stage, parameters=first.parameters, inputs=inputs)
    elif odd and dataset.kind != "raw":
        one, other = (shown(dataset.parts[number].session) for number in (0, odd[0]))
        raise DataError(
            f"{name_of(dataset.folder)}: sessions {one} and {other} have different provenance, see "
            "`hydro show` of each: make the folder again"
        )
    return Artefact(dataset.kind, frame, whole)


def _unique(inputs: Iterable[Input]) -> tuple[Input, ...]:
    """Return inputs in their order without duplicates."""
    return tuple({msgspec.json.encode(each, order="sorted"): each for each in inputs}.values())


def write(artefact: Artefact, destination: Source) -> None:
    """Write an artefact to a path (atomically) or a binary stream; the same artefact gives the same bytes.

    Args:
        artefact: The table with its provenance.
        destination: Path or binary stream.

    Raises:
        DataError: The table breaks its schema, or the operating system refuses.
        UsageError: The stream is a terminal.
        BrokenPipeError: The reader of the stream has closed.
    """
    schema.suited(artefact.kind, artefact.frame).check(artefact.frame, name_of(destination, "stdout"))
    if isinstance(destination, str | Path):
        with whole_file(destination) as stream:
            _encode(artefact, stream)
    else:
        sink = pa.BufferOutputStream()
        _encode(artefact, sink)
        write_bytes(memoryview(sink.getvalue()), destination)


def write_all(parts: Mapping[Path, Artefact]) -> None:
    """Write the files of several new sessions of a dataset; if one fails, remove all that were written.

    Args:
        parts: The tables, by the paths that `partitions.place` returned.

    Raises:
        DataError: The operating system refused.
    """
    begun: list[Path] = []
    try:
        for path, part in parts.items():
            begun.append(path)
            path.parent.mkdir(parents=True, exist_ok=True)
            write(part, path)
    except BaseException:
        for path in begun:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
                path.parent.rmdir()
        raise


def _encode(artefact: Artefact, sink: Any) -> None:
    """Write the Parquet bytes of an artefact, independent of the chunks of its frame, to a file or buffer."""
    arrow = artefact.frame.rechunk().to_arrow(compat_level=pl.CompatLevel.oldest())
    texts = [name for name, dtype in artefact.frame.schema.items() if dtype == pl.String]
    writer = pq.ParquetWriter(
        sink, arrow.schema, compression="zstd", compression_level=1, use_dictionary=texts
    )
    with writer:
        writer.write_table(arrow, row_group_size=ROWS_PER_GROUP)
        writer.add_key_value_metadata({provenance.FOOTER_KEY: artefact.provenance.to_json()})
