"""Build the wheel deep-hydro-sim-data from the folder of the full Stonefish recordings.

    python packaging/data/build.py RECORDINGS -o dist

Every table is read, encoded again without loss, read back and compared by its content hash.  The wheel has
the tables, their manifest with SHA-256 sums, and Croissant metadata.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import polars as pl
import pyarrow.parquet as pq
from croissant import described

from hydro.io import provenance, schema, table
from hydro.io.companion import FORMAT, PACKAGE

HERE = Path(__file__).resolve().parent
DATASETS = HERE.parents[1] / "datasets" / "stonefish"
LEVEL = 19
"""Zstandard level.  v1_current has 4.40 MB; 4.53 at level 9, 4.69 at 1, 6.01 without byte-stream split."""
UNNEEDED = ("__pycache__", "build.py", "croissant.py", "dist")
"""Parts of this folder that are not packaged."""
MOST = 95e6
"""Greatest size of the wheel [bytes]: package indexes refuse files of more than 100 MB."""
ABOUT = {
    "nominal": "unchanged vehicle, to fit",
    "nominal_test": "unchanged vehicle, other seeds, to test",
    "replay90": "unchanged vehicle, 90 s in nine segments",
    "v1_current": "current of 0.35 m/s toward 40 degrees",
    "v1_current_replay90": "the same, 90 s in nine segments",
    "v3_thruster3": "thruster 3 at 60 % of its thrust",
    "v3_thruster3_replay90": "the same, 90 s in nine segments",
}
"""Tables of the distribution, each with its content."""
BESIDE = {
    "vehicle.json": "facts of the vehicle, with conventions",
    "sessions.json": "kind, seed and rows of each session",
    "hull.obj": "surface of the hull",
    "vehicle.toml": "vehicle file without damping",
}
"""Other files, each with its content."""


def encode(artefact: table.Artefact, path: Path) -> None:
    """Write a table in the smallest lossless encoding that was measured, with hydro's footer."""
    arrow = artefact.frame.rechunk().to_arrow(compat_level=pl.CompatLevel.oldest())
    numbers = [name for name, dtype in artefact.frame.schema.items() if dtype.is_numeric()]
    texts = [name for name in artefact.frame.columns if name not in numbers]
    with pq.ParquetWriter(
        path,
        arrow.schema,
        compression="zstd",
        compression_level=LEVEL,
        use_dictionary=texts,
        use_byte_stream_split=numbers,
    ) as writer:
        writer.write_table(arrow, row_group_size=table.ROWS_PER_GROUP)
        writer.add_key_value_metadata({provenance.FOOTER_KEY: artefact.provenance.to_json()})


def copied(source: Path, name: str, target: Path, vehicle: str) -> dict[str, Any]:
    """Encode one table again and return its entry of the manifest.

    Raises:
        SystemExit: The values differ afterwards.
    """
    frame = schema.suited("raw", given := pl.read_parquet(source)).conform(given)
    before = provenance.content_hash(given)
    artefact = table.make(
        "raw",
        frame,
        stage="import",
        parameters={"simulator": "Stonefish 1.6.0", "file": source.name},
        vehicle_text=vehicle,
    )
    path = target / f"{name}.parquet"
    encode(artefact, path)
    if table.read(path, "raw").provenance.content != before:
        raise SystemExit(f"{path.name}: the values differ from {source}: check the encoding")
    was, now = source.stat().st_size, path.stat().st_size
    print(f"{path.name}: {was / 1e6:.2f} MB, now {now / 1e6:.2f} MB; {before}", flush=True)
    return entry(path, ABOUT[name]) | {
        "rows": frame.height,
        "sessions": frame["session"].n_unique(),
        "content": before,
    }


def entry(path: Path, about: str) -> dict[str, Any]:
    """Return the entry of a file of any kind in the manifest."""
    content = path.read_bytes()
    return {
        "name": path.name,
        "about": about,
        "bytes": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
    }


def filled(recordings: Path, package: Path, names: Sequence[str], version: str) -> None:
    """Fill the package with tables, other files, manifest and Croissant metadata."""
    target = package / "stonefish"
    target.mkdir(parents=True, exist_ok=True)
    vehicle = (DATASETS / "vehicle.toml").read_text()
    entries = [copied(recordings / f"{name}.parquet", name, target, vehicle) for name in names]
    for name, about in BESIDE.items():
        source = DATASETS / name if name.endswith((".toml", ".obj")) else recordings / name
        shutil.copyfile(source, target / name)
        entries.append(entry(target / name, about))
    manifest = {"format": FORMAT, "version": version, "files": entries}
    (package / "manifest.json").write_text(json.dumps(manifest, indent=1) + "\n")
    metadata = described(manifest, schema.load("raw"))
    (package / "croissant.json").write_text(json.dumps(metadata, indent=1) + "\n")


def wheel(recordings: Path, out: Path, names: Sequence[str] = tuple(ABOUT)) -> Path:
    """Build the wheel and return its path.

    Raises:
        SystemExit: The build fails, or the wheel is too large.
    """
    version = tomllib.loads((HERE / "pyproject.toml").read_text())["project"]["version"]
    with tempfile.TemporaryDirectory() as scratch:
        tree = Path(scratch) / "tree"
        shutil.copytree(
            HERE, tree, ignore=shutil.ignore_patterns("*.py[co]", "__pycache__", "build.py", "dist")
        )
        filled(recordings, tree / PACKAGE, names, version)
        line = [
            sys.executable,
            "-m",
            "build",
            "--wheel",
            "--no-isolation",
            "--outdir",
            str(Path(scratch) / "out"),
        ]
        done = subprocess.run([*line, str(tree)], cwd=scratch, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(done.stdout + done.stderr)
        (built,) = (Path(scratch) / "out").glob("*.whl")
        if built.stat().st_size > MOST:
            raise SystemExit(
                f"{built.name}: {built.stat().st_size / 1e6:.1f} MB, over {MOST / 1e6:.0f}: leave out a table"
            )
        out.mkdir(parents=True, exist_ok=True)
        return Path(shutil.move(built, out / built.name))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("recordings", type=Path, help="folder with nominal.parquet and the other tables")
    parser.add_argument("-o", "--out", type=Path, default=Path("dist"), help="folder for the wheel")
    chosen = parser.parse_args()
    built = wheel(chosen.recordings, chosen.out)
    print(f"{built}: {built.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
