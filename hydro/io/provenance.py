"""Where a table comes from: the record in its Parquet footer, the hash of its content, its lineage.

The record holds no clock and no host name: the same inputs give the same bytes.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from typing import Annotated, Any, Literal, NotRequired, TypedDict

import msgspec
import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.errors import DataError
from hydro.core.nesting import too_deep
from hydro.core.threads import available
from hydro.io.schema import storage_type

FOOTER_KEY = b"hydro"
"""The key of the record in a Parquet file's footer."""
_BEGIN = b'{"check":"'


class Before(TypedDict):
    """What a table says of a recording before; see `report.change`."""

    recording: str
    given: float
    left: float
    network: NotRequired[str]
    learnt: NotRequired[bool]


class _Any(TypedDict, total=False):
    """Parameters that are read again from a table of any stage."""

    before: Before
    chi2: list[float]
    part: str


class _Labelled(_Any, total=False):
    noise: Annotated[list[float], msgspec.Meta(min_length=6, max_length=6)]
    subtract: Literal["inertia", "effects"]


class _Divided(_Any, total=False):
    block: Annotated[int, msgspec.Meta(ge=1)]
    test: float
    salt: str


_PARAMETERS: dict[str | None, type] = {"labels": _Labelled, "split": _Divided}
"""Those of some stages alone; a table may have others beside them."""


class Input(msgspec.Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """What a table was made from, and what that was made from in turn.

    Attributes:
        kind: kind of table, or `vehicle`.
        content: hash of its content.
        stage: the command that made it.
        parameters: parameters of that command.
        inputs: what it was made from itself.
    """

    kind: str
    content: str
    stage: str | None = None
    parameters: dict[str, Any] = {}
    inputs: tuple[Input, ...] = ()


class Provenance(msgspec.Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """The record in the footer.

    Attributes:
        kind: kind of table.
        schema: digest of the rules it was checked by.
        content: hash of its columns, see `content_hash`.
        stage: the command that wrote it; None for a table from elsewhere.
        parameters: what the result depends on besides inputs and seed.
        seed: seed of everything random.
        package: version of hydro that wrote it.
        inputs: what it was made from.
        vehicle: text of the vehicle file that the data belong to.
        model: what a network is beside its tensors.
        format: version of this record.
        check: hash of all else in the record; in a file alone, where it comes first.
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
        """How a table that is made from this one refers to it."""
        return Input(self.kind, self.content, self.stage, self.parameters, self.inputs)

    def to_json(self) -> bytes:
        """The record as JSON with its hash before it, the same bytes for the same record."""
        body = msgspec.json.encode(self, order="sorted")
        return _BEGIN + _digest(body) + b'",' + body[1:]


def from_json(text: bytes, source: str) -> Provenance:
    """Read the record of a footer.

    Raises:
        DataError: it is not a record of this version, or was changed after it was written.
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
    if record.check is None:  # of an earlier version, or from elsewhere
        return record
    start = len(_BEGIN) + len(_digest(b"")) + 2
    if text[:start] != _BEGIN + _digest(b"{" + text[start:]) + b'",':
        raise DataError(f"{source}: its `hydro` footer was changed after it was written: make the file again")
    return msgspec.structs.replace(record, check=None)


def _check_parameters(stage: str | None, parameters: Mapping[str, Any]) -> None:
    """Refuse parameters that are read again and are of another type.

    Raises:
        msgspec.ValidationError: One is.
    """
    try:
        msgspec.convert(parameters, _PARAMETERS.get(stage, _Any))
    except msgspec.ValidationError as error:
        raise msgspec.ValidationError(f"parameters: {error}") from None


def _digest(content: bytes) -> bytes:
    """A hash as records write it."""
    return b"sha256:" + hashlib.sha256(content).hexdigest().encode()


@functools.cache
def package_version() -> str:
    """The version of this package, as installed."""
    return metadata.version("deep-hydro-sim")


def lineage(provenance: Provenance) -> Iterator[tuple[int, Input]]:
    """A table and all it was made from, each with its depth: the table itself 0, its inputs 1, theirs 2."""

    def walk(depth: int, node: Input) -> Iterator[tuple[int, Input]]:
        yield depth, node
        for parent in node.inputs:
            yield from walk(depth + 1, parent)

    return walk(0, provenance.as_input())


def parameters_of(provenance: Provenance, stage: str) -> dict[str, Any]:
    """The parameters of a stage in a table's lineage, of the nearest one; empty where there is none."""
    found = [(depth, node.parameters) for depth, node in lineage(provenance) if node.stage == stage]
    return min(found, key=lambda one: one[0])[1] if found else {}


def json_schema() -> dict[str, Any]:
    """The JSON Schema of the record, made from the structs above."""
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "The `hydro` footer of an artefact",
    }
    return schema | msgspec.json.schema(Provenance)


def content_hash(frame: pl.DataFrame) -> str:
    """SHA-256 of a table's columns in canonical form.

    Each column is hashed apart: its logical type, which rows are missing, and the values as little-endian
    float64 or int64, or as UTF-8 with their lengths.  One hash over these digests and the names, in the order
    of names, is the table's.  So it does not depend on chunks, row groups or the order of columns, nor on
    whether the same numbers are stored as float32 or float64.

    Returns:
        `sha256:` and 64 hexadecimal digits.
    """
    names = sorted(frame.columns)
    with ThreadPoolExecutor(min(len(names), available()) or 1) as pool:  # hashlib releases the GIL
        digests = pool.map(lambda name: _column_digest(frame[name]), names)
        whole = hashlib.sha256()
        for name, digest in zip(names, digests, strict=True):
            encoded = name.encode()
            whole.update(len(encoded).to_bytes(8, "little") + encoded + digest)
    return f"sha256:{whole.hexdigest()}"


def _column_digest(values: pl.Series) -> bytes:
    """Hash of one column: logical type, which rows are missing, then the values."""
    digest = hashlib.sha256()
    if isinstance(values.dtype, pl.List):
        digest.update(b"list")
        _add_missing(digest, values)
        digest.update(_little(values.list.len().fill_null(0).to_numpy(), "<i8"))
        digest.update(_column_digest(values.drop_nulls().explode(empty_as_null=False)))
        return digest.digest()
    if storage_type(values.dtype) == "string":
        digest.update(b"string")
        _add_missing(digest, values)
        texts = values.cast(pl.String).fill_null("")
        digest.update(_little(texts.str.len_bytes().to_numpy(), "<i8"))
        digest.update(texts.str.join("").item().encode())
        return digest.digest()
    logical = "float64" if values.dtype.is_float() else "int64"
    digest.update(logical.encode())
    _add_missing(digest, values)
    digest.update(_little(values.fill_null(0).to_numpy(), "<f8" if logical == "float64" else "<i8"))
    return digest.digest()


def _add_missing(digest: hashlib._Hash, values: pl.Series) -> None:
    """Length of the column, and where values are missing if any are."""
    digest.update(len(values).to_bytes(8, "little"))
    if values.null_count():
        digest.update(np.packbits(values.is_null().to_numpy()).data)


def _little(numbers: NDArray[Any], dtype: str) -> memoryview:
    """The numbers as contiguous little-endian bytes; no copy where they already are."""
    return np.ascontiguousarray(numbers, dtype=dtype).data
