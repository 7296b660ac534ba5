"""Make the bundled samples from the full Stonefish recordings: python datasets/make.py RECORDINGS."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import polars as pl

from hydro.io import table

HERE = Path(__file__).parent / "stonefish"
ROWS = 1033
"""First rows of every session that the sample takes: sessions begin at rest, and so do the rotors."""


def main(recordings: Path) -> None:
    """Write the heads of nominal.parquet's sessions, and replay90.parquet, the vehicle in their footers."""
    vehicle = (HERE / "vehicle.toml").read_text()
    nominal = pl.read_parquet(recordings / "nominal.parquet")
    heads = nominal.filter(pl.int_range(pl.len()).over("session") < ROWS)
    replay = pl.read_parquet(recordings / "replay90.parquet")
    for name, frame, source in (
        ("sample", heads, "nominal.parquet"),
        ("replay90", replay, "replay90.parquet"),
    ):
        parameters: dict[str, Any] = {"simulator": "Stonefish 1.6.0", "file": source}
        if name == "sample":
            parameters["rows_of_each_session"] = ROWS
        artefact = table.make("raw", frame, stage="import", parameters=parameters, vehicle_text=vehicle)
        table.write(artefact, HERE / f"{name}.parquet")
        print(f"{name}.parquet  {frame.height} rows  {artefact.provenance.content}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
