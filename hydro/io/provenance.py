"""Provenance of a table: the record in its Parquet footer, the hash of its content, its lineage.

The record has no time and no host name, so the same inputs give the same bytes.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterator, Mapping
from importlib import metadata
from typing import Annotated, Any, Literal, NotRequired, TypedDict

import msgspec
import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.errors import DataError
from hydro.core.nesting import too_deep
from hydro.core.threads import spread
from hydro.io.schema import storage_type

FOOTER_KEY = b"hydro"
"""Key of the record in a Parquet file's footer."""
_BEGIN = b'{"check":"'
ROWS_IN_THREADS = 50_000
"""Rows of a table from which its columns are hashed in parallel: threads start in about a millisecond."""


class Before(TypedDict):
    """Entry in a table's footer on the recording from before a change, see `report.change`.

    Attributes:
        recording: Name of the recording.
        given: Squared error with the vehicle file alone.
        left: Squared error with the hull-force model.
        network: Name of the network that is the hull-force model; absent without one.
        learnt: Whether that network was trained on the recording; absent without a network.
    """

    recording: str
    given: float
    left: float
    network: NotRequired[str]
    learnt: NotRequired[bool]


class _Common(TypedDict, total=False):
    """Parameters that are read back from a table of any stage."""

    before: Before
    chi2: list[float]
    part: str


class _LabelsParameters(_Common, total=False):
    noise: Annotated[list[float], msgspec.Meta(min_length=6, max_length=6)]
    subtract: Literal["inertia", "effects"]


class _SplitParameters(_Common, total=False):
    block: Annotated[int, msgspec.Meta(ge=1)]
    test: float
    salt: str


_PARAMETERS: dict[str | None, type] = {"labels": _LabelsParameters, "split": _SplitParameters}
"""Parameters that are read back from tables of some stages; a table may have others too."""


class Input(msgspec.Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """Artefact (a table or file that hydro reads or writes) from which a table was made, with its own inputs.

    Attributes:
        kind: Kind of table, or `vehicle`.
        content: Hash of its content.
        stage: Command that made the artefact.
        parameters: Parameters of that command.
        inputs: Artefacts from which the artefact was made.
    """

    kind: str
    content: str
    stage: str | None = None
    parameters: dict[str, Any] = {}
    inputs: tuple[Input, ...] = ()


class Provenance(msgspec.Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """Record in the footer of a table: its kind, content hash, and all that determined its content.

    Attributes:
        kind: Kind of table.
        schema: Digest of the schema by which the table was checked.
        content: Hash of its columns, see `content_hash`.
        stage: Command that wrote the table; None for a table that hydro did not write.
        parameters: Parameters, besides inputs and seed, that determine the result.
        seed: Seed of all random numbers.
        package: Version of hydro that wrote the table.
        inputs: Artefacts from which the table was made.
        vehicle: Text of the vehicle file of the data.
        model: Description of a network without its tensors.
        format: Version of this record.
        check: Hash of the rest of the record; only in a file, where it comes first.
    """

    kind: str
    schema: str
    content: str
    stage: str | None = None
    parameters: dict[str, Any] = {}
    seed: int | None = None
    package: str | None = None
    inputs: tuple[Input, ...] = ()
    vehicle: str | None = None
    model: dict[str, Any] | None = None
    format: str = "hydro-artefact/1"
    check: str | None = None

    def as_input(self) -> Input:
        """Return this record as an `Input`, for the provenance of a table made from the recorded one."""
        return Input(self.kind, self.content, self.stage, self.parameters, self.inputs)

    def to_json(self) -> bytes:
        """Return the record as JSON, preceded by its hash; the same record gives the same bytes."""
        body = msgspec.json.encode(self, order="sorted")
        return _BEGIN + _digest(body) + b'",' + body[1:]


def from_json(text: bytes, source: str) -> Provenance:
    """Return the provenance that the footer of a table states.

    Args:
        text: JSON of the footer.
        source: Name of the file in error messages.

    Raises:
        DataError: The text is not a record of this version, or was changed after it was written.
    """
    try:
        record = msgspec.json.decode(text, type=Provenance)
        if too_deep(msgspec.to_builtins(record)):
            raise msgspec.ValidationError("nested too deeply")
        for _, node in lineage(record):
            _check_parameters(node.stage, node.parameters)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise DataError(
            f"{source}: its `hydro` footer cannot be read ({error}): write the file again"
        ) from error
    if record.check is None:  # written by an earlier version, or elsewhere
        return record
    start = len(_BEGIN) + len(_digest(b"")) + 2
    if text[:start] != _BEGIN + _digest(b"{" + text[start:]) + b'",':
        raise DataError(f"{source}: its `hydro` footer was changed after it was written: make the file again")
    return msgspec.structs.replace(record, check=None)


def _check_parameters(stage: str | None, parameters: Mapping[str, Any]) -> None:
    """Check the types of those parameters that hydro reads back from a footer.

    Args:
        stage: Command that wrote the table.
        parameters: Parameters of the command.

    Raises:
        msgspec.ValidationError: A parameter has the wrong type.
    """
    try:
        msgspec.convert(parameters, _PARAMETERS.get(stage, _Common))
    except msgspec.ValidationError as error:
        raise msgspec.ValidationError(f"parameters: {error}") from None


def _digest(content: bytes) -> bytes:
    """Return `sha256:` and the SHA-256 of bytes, hexadecimal."""
    return b"sha256:" + hashlib.sha256(content).hexdigest().encode()


@functools.cache
def package_version() -> str:
    """Return the installed version of this package."""
    return metadata.version("deep-hydro-sim")


def lineage(provenance: Provenance) -> Iterator[tuple[int, Input]]:
    """Yield a table and all its inputs, each with its depth: 0 for the table, 1 for its inputs, and so on."""

    def walk(depth: int, node: Input) -> Iterator[tuple[int, Input]]:
        yield depth, node
        for parent in node.inputs:
            yield from walk(depth + 1, parent)

    return walk(0, provenance.as_input())


def parameters_of(provenance: Provenance, stage: str) -> dict[str, Any]:
    """Return the parameters with which a stage (command) made the latest of its tables in a table's lineage.

    Args:
        provenance: Provenance of the table.
        stage: Name of the command.

    Returns:
        Parameters by name; empty if no table of the stage is in the lineage.
    """
    found = [(depth, node.parameters) for depth, node in lineage(provenance) if node.stage == stage]
    return min(found, key=lambda one: one[0])[1] if found else {}


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of the record, generated from the structs above."""
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "The `hydro` footer of an artefact",
    }
    return schema | msgspec.json.schema(Provenance)


def content_hash(frame: pl.DataFrame) -> str:
    """Return the SHA-256 of a table's columns in canonical form.

    Each column is hashed separately: its logical type, its missing rows, and its values.  Values are
    little-endian float64 or int64, or UTF-8 with their lengths.  The hash of the table is one hash over these
    digests and the names, sorted by name.  So it does not depend on chunks, row groups or column order.  Nor
    does it depend on whether the same numbers are stored as float32 or float64.

    Returns:
        `sha256:` and 64 hexadecimal digits.
    """
    names = sorted(frame.columns)
    threads = None if frame.height > ROWS_IN_THREADS else 1  # hashlib releases the GIL
    digests = spread(lambda name: _column_digest(frame[name]), names, threads)
    whole = hashlib.sha256()
    for name, digest in zip(names, digests, strict=True):
        encoded = name.encode()
        whole.update(len(encoded).to_bytes(8, "little") + encoded + digest)
    return f"sha256:{whole.hexdigest()}"


def _column_digest(values: pl.Series) -> bytes:
    """Return the hash of one column: logical type, missing rows, then the values."""
    digest = hashlib.sha256()
    if isinstance(values.dtype, pl.List):
        digest.update(b"list")
        _add_missing(digest, values)
        digest.update(_little(_filled(values.list.len(), 0).to_numpy(), "<i8"))
        digest.update(_column_digest(values.drop_nulls().explode(empty_as_null=False)))
        return digest.digest()
    if storage_type(values.dtype) == "string":
        digest.update(b"string")
        _add_missing(digest, values)
        texts = _filled(values.cast(pl.String), "")
        digest.update(_little(texts.str.len_bytes().to_numpy(), "<i8"))
        digest.update(texts.str.join("").item().encode())
        return digest.digest()
    logical = "float64" if values.dtype.is_float() else "int64"
    digest.update(logical.encode())
    _add_missing(digest, values)
    digest.update(_little(_filled(values, 0).to_numpy(), "<f8" if logical == "float64" else "<i8"))
    return digest.digest()


def _filled(values: pl.Series, replacement: int | str) -> pl.Series:
    """Return a column with its missing rows replaced; the column itself if there are none."""
    return values.fill_null(replacement) if values.null_count() else values


def _add_missing(digest: hashlib._Hash, values: pl.Series) -> None:
    """Add the length of the column to a hash, and its missing rows if there are any."""
    digest.update(len(values).to_bytes(8, "little"))
    if values.null_count():
        digest.update(np.packbits(values.is_null().to_numpy()).data)


def _little(numbers: NDArray[Any], dtype: str) -> memoryview:
    """Return numbers as contiguous little-endian bytes, without a copy if they already are."""
    return np.ascontiguousarray(numbers, dtype=dtype).data
