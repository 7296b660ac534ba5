"""Sound files of every kind, and the commands that take one in which something is wrong."""

from __future__ import annotations

import contextlib
import io
import json
import os
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import polars as pl
import pyarrow.parquet as pq
import tomlkit

import hydro
from hydro import cli
from hydro.core import toml_text
from hydro.io.files import bundled
from hydro.io.provenance import FOOTER_KEY

SPOILT = "SPOILT"
"""Stands for the file in which something is wrong."""
VEHICLE = (
    f"check {SPOILT}",
    f"compare {SPOILT} raw.parquet",
    f"simulate {SPOILT} commands.parquet -o out.parquet",
    f"labels raw.parquet --vehicle {SPOILT} -o out.parquet",
    f"fit {SPOILT} raw.parquet -o out.toml",
    f"diagnose {SPOILT} raw.parquet -o out.parquet",
    f"explain {SPOILT} raw.parquet -o out",
    f"add {SPOILT} diagnosis.parquet -o out.toml",
    f"replay raw.parquet --vehicle {SPOILT} -o out.parquet",
    f"collect --vehicle {SPOILT} --excitation walks --rows 50 --threads 1 -o out.parquet",
    f"import log.csv --map map.toml --vehicle {SPOILT} -o out.parquet",
)
MAP = (
    f"check {SPOILT}",
    f"import log.csv --map {SPOILT} -o out.parquet",
    f"compare rov.toml log.csv --map {SPOILT}",
)
TABLES = {
    "raw": (
        f"labels {SPOILT} -o out.parquet",
        f"compare vehicle.toml {SPOILT}",
        f"fit vehicle.toml {SPOILT}",
    ),
    "labels": (f"split {SPOILT} -o out.parquet", f"features {SPOILT} -o out.parquet"),
    "split": (
        f"evaluate model.parquet --labels {SPOILT}",
        f"train {SPOILT} --model mlp --epochs 1 -o out.parquet",
    ),
    "model": (
        f"evaluate {SPOILT} --labels split.parquet",
        f"replay raw.parquet --model {SPOILT} -o out.parquet",
    ),
    "diagnosis": (f"add vehicle.toml {SPOILT} -o out.toml", f"report {SPOILT} -o out.html"),
    "comparison": (f"report {SPOILT} -o out.html", f"compare vehicle.toml raw.parquet --against {SPOILT}"),
    "commands": (f"simulate vehicle.toml {SPOILT} -o out.parquet",),
}
ALWAYS = (f"check {SPOILT}", f"show {SPOILT}")
LOG = (f"import {SPOILT} --topics", f"import {SPOILT} --map map.toml -o out.parquet")


@dataclass
class Workshop:
    """A folder with sound files, in which commands are run.

    Attributes:
        folder: It.
        counts: Cases that were tried, by kind, and how many of them were refused.
    """

    folder: Path
    counts: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        """Make the sound files."""
        os.chdir(self.folder)
        (self.folder / "vehicle.toml").write_bytes((bundled("stonefish") / "vehicle.toml").read_bytes())
        for name in ("map.toml", "rov.toml"):
            (self.folder / name).write_bytes((bundled("logs") / name).read_bytes())
        log = (bundled("logs") / "example.csv").read_text().splitlines()
        (self.folder / "log.csv").write_text("\n".join(log[:200]) + "\n")
        whole = hydro.read(bundled("stonefish") / "replay90.parquet")
        text = (self.folder / "vehicle.toml").read_text()
        hydro.write(whole.head(400), "raw.parquet", "raw", vehicle_file="vehicle.toml")
        hydro.write(whole.head(1700), "longer.parquet", "raw")
        commands = [name for name in whole.columns if name.startswith("cmd_")]
        hydro.write(whole.head(100).select("session", "t", *commands), "commands.parquet", "commands")
        for line in (
            "labels raw.parquet --vehicle vehicle.toml -o labels.parquet",
            "split labels.parquet -o split.parquet",
            "train split.parquet --model mlp --epochs 1 -o model.parquet",
            "compare vehicle.toml raw.parquet -o comparison.parquet",
            "diagnose vehicle.toml longer.parquet -o diagnosis.parquet",
        ):
            code, said = self.run(line)
            assert code == 0, f"{line}: {said}"
        self.vehicle = toml_text.content(text)
        self.map = toml_text.content((self.folder / "map.toml").read_text())

    def run(self, line: str) -> tuple[int, str]:
        """Run a command in this process; its exit code, and what it said on stderr."""
        said, out = io.StringIO(), io.TextIOWrapper(io.BytesIO())
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
            code = cli.main(line.split())
        return code, said.getvalue()

    def toml(self, nested: dict[str, Any]) -> Path:
        """Write nested values as TOML, as far as it has them."""
        path = self.folder / "spoilt.toml"
        path.write_text(tomlkit.dumps(nested))
        return path

    def parquet(self, kind: str, frame: pl.DataFrame | None, footer: dict[str, Any] | None) -> Path:
        """Write a table with other rows or another footer; without one it is as any program wrote it."""
        path = self.folder / "spoilt.parquet"
        table = (self.table(kind) if frame is None else frame).to_arrow(compat_level=pl.CompatLevel.oldest())
        with pq.ParquetWriter(path, table.schema) as writer:
            writer.write_table(table)
            if footer is not None:
                writer.add_key_value_metadata({FOOTER_KEY: json.dumps(footer).encode()})
        return path

    def footer(self, kind: str) -> dict[str, Any]:
        """The footer of the sound table of a kind, without its own hash: as one that was made elsewhere."""
        said = pq.read_metadata(self.folder / f"{kind}.parquet").metadata[FOOTER_KEY]
        found: dict[str, Any] = json.loads(said)
        found.pop("check", None)
        return found

    def table(self, kind: str) -> pl.DataFrame:
        """The sound table of a kind."""
        return pl.read_parquet(self.folder / f"{kind}.parquet")

    def hold(self, kind: str, line: str, path: Path) -> None:
        """Run a command on a file in which something is wrong: it works, or says in a line what is."""
        for left in self.folder.glob("out*"):
            left.unlink() if left.is_file() else [each.unlink() for each in left.iterdir()]
        before = {one.name for one in self.folder.iterdir()}
        code, said = self.run(line.replace(SPOILT, path.name))
        self.counts[kind] += 1
        self.counts[f"{kind}, refused"] += code != 0
        told = [one for one in said.splitlines() if not one.startswith("hydro: warning")]
        assert code in (0, 1, 2), f"{line}: exit {code}: {said}"
        assert "Traceback" not in said and "bug" not in said, f"{line}: {said}"  # noqa: PT018
        if code:
            assert told and told[-1].startswith("hydro: ") and len(told[-1]) > 20, f"{line}: {said!r}"  # noqa: PT018
            left_behind = {one.name for one in self.folder.iterdir()} - before
            assert not left_behind, f"{line}: left {left_behind}"
