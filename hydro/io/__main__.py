"""`python -m hydro.io`: write the schema files generated from structs (vehicle, map and footer)."""

from __future__ import annotations

import inspect

import msgspec

from hydro.io import logmap, provenance, vehicle
from hydro.io.schema import FOLDER


def generated() -> dict[str, bytes]:
    """Return the bytes of each generated schema file, by file name."""
    schemas = {
        "vehicle.schema.json": vehicle.json_schema(),
        "map.schema.json": logmap.json_schema(),
        "footer.schema.json": provenance.json_schema(),
    }
    for schema in schemas.values():
        for part in schema["$defs"].values():
            part["description"] = inspect.cleandoc(part["description"])
    return {
        name: msgspec.json.format(msgspec.json.encode(schema, order="deterministic"), indent=2) + b"\n"
        for name, schema in schemas.items()
    }


if __name__ == "__main__":
    for name, content in generated().items():
        (FOLDER / name).write_bytes(content)
