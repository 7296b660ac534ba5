"""Make the bundled samples from the full Stonefish recordings: python datasets/make.py RECORDINGS."""

from __future__ import annotations

import sys
from pathlib import Path

import polars as pl

from hydro.io import table

HERE = Path(__file__).parent / "stonefish"
SESSIONS = (
    "nom_004_sweep_surge",
    "nom_005_sweep_yaw",
    "nom_007_coupled",
    "nom_013_ou",
    "nom_015_sweep_sway",
    "nom_039_sweep_heave",
    "nom_049_coupled",
    "nom_054_ou",
)


def main(recordings: Path) -> None:
    """Write whole sessions of nominal.parquet, and replay90.parquet, with the vehicle in their footers."""
    vehicle = (HERE / "vehicle.toml").read_text()
    nominal = pl.read_parquet(recordings / "nominal.parquet").filter(pl.col("session").is_in(SESSIONS))
    replay = pl.read_parquet(recordings / "replay90.parquet")
    for name, frame, source in (
        ("sample", nominal, "nominal.parquet"),
        ("replay90", replay, "replay90.parquet"),
    ):
        parameters = {
            "simulator": "Stonefish 1.6.0",
            "file": source,
            "sessions": sorted(set(frame["session"])),
        }
        artefact = table.make("raw", frame, stage="import", parameters=parameters, vehicle_text=vehicle)
        table.write(artefact, HERE / f"{name}.parquet")
        print(f"{name}.parquet  {frame.height} rows  {artefact.provenance.content}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
