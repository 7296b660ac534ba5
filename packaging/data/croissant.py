"""Croissant 1.0 metadata of the distribution, from its manifest and the schema of a raw table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from hydro.io.schema import Schema

CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "arrayShape": "cr:arrayShape",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileProperty": "cr:fileProperty",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
"""Standard context of the format: terms that a reader resolves."""
FORMATS = {
    ".parquet": "application/x-parquet",
    ".json": "application/json",
    ".toml": "application/toml",
    ".obj": "model/obj",
}
"""Media types by the end of a file's name."""
THRUSTERS = 8
PUBLISHED = "2026-11-28"


def described(manifest: Mapping[str, Any], raw: Schema) -> dict[str, Any]:
    """Return the metadata of all files, with a record set for each table.

    Args:
        manifest: Content of `manifest.json`.
        raw: Schema of a raw table.
    """
    tables = [one for one in manifest["files"] if one["name"].endswith(".parquet")]
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "name": "deep-hydro-sim-data",
        "description": "Motion of an underwater vehicle recorded in the simulator Stonefish: unchanged, in a "
        "current, and with a weak thruster.",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "license": "https://creativecommons.org/licenses/by/4.0/",
        "url": f"urn:deep-hydro-sim-data:{manifest['version']}",
        "version": manifest["version"],
        "datePublished": PUBLISHED,
        "creator": {"@type": "sc:Organization", "name": "the hydro contributors"},
        "citeAs": "deep-hydro-sim-data, the hydro contributors, 2026",
        "distribution": [_file(one) for one in manifest["files"]],
        "recordSet": [_records(one, raw) for one in tables],
    }


def _file(one: Mapping[str, Any]) -> dict[str, Any]:
    """Return the description of a file."""
    name = str(one["name"])
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "description": one["about"],
        "contentUrl": f"stonefish/{name}",
        "contentSize": f"{one['bytes']} B",
        "encodingFormat": FORMATS[name[name.rindex(".") :]],
        "sha256": one["sha256"],
    }


def _records(one: Mapping[str, Any], raw: Schema) -> dict[str, Any]:
    """Return the record set of a table: one record per row."""
    kind = str(one["name"]).removesuffix(".parquet")
    return {
        "@type": "cr:RecordSet",
        "@id": kind,
        "name": kind,
        "description": f"{one['about']}: {one['rows']} rows in {one['sessions']} sessions",
        "field": list(_fields(kind, str(one["name"]), raw)),
    }


def _fields(kind: str, file: str, raw: Schema) -> Iterator[dict[str, Any]]:
    """Yield the required columns of a raw table, with unit and frame."""
    commands = [f"cmd_{number}" for number in range(1, THRUSTERS + 1)]
    names = ["session", "t", *"xyz", "phi", "theta", "psi", *"uvwpqr", *commands]
    for name, column in raw.columns(names).items():
        unit = f" [{column.unit}]" if column.unit else ""
        yield {
            "@type": "cr:Field",
            "@id": f"{kind}/{name}",
            "name": name,
            "description": f"{column.description}{unit}",
            "dataType": "sc:Text" if name == "session" else "sc:Float",
            "source": {"fileObject": {"@id": file}, "extract": {"column": name}},
        }
