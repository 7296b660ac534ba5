"""Files of a case and of an answer, as an entrant sees them.

A folder of cases has `seals.csv` and a folder per case:

    case.json         format, number of thrusters, times [s], whether there is an earlier log
    vehicle.toml      vehicle file
    log.parquet       raw table of the vehicle to diagnose
    before.parquet    raw table of the same vehicle earlier; only some cases have it
    heldout.parquet   windows: raw tables of LEAD seconds of motion and commands, then AHEAD of commands alone

An entry is a folder with a folder per case: `answer.json` with named effects, and `prediction.parquet` with
the velocities in the windows.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

FORMAT = "hydro-challenge/1"
LEAD, AHEAD = 2.0, 5.0
"""Seconds of a window with motion, and seconds to predict."""
EVERY = 0.1
"""Interval of predictions [s]."""
VELOCITY = ("u", "v", "w", "p", "q", "r")
MOTION = ("x", "y", "z", "phi", "theta", "psi", *VELOCITY)


@dataclass(frozen=True)
class Public:
    """Case as an entrant sees it.

    Attributes:
        name: Name of the case's folder.
        vehicle: Text of the vehicle file.
        log: Raw table.
        before: Raw table of the unchanged vehicle; None without one.
        held_out: Windows, with motion up to LEAD and nulls after it.
    """

    name: str
    vehicle: str
    log: pl.DataFrame
    before: pl.DataFrame | None
    held_out: pl.DataFrame

    def write(self, folder: Path) -> None:
        """Write the files of the case into `folder`/NAME."""
        there = folder / self.name
        there.mkdir(parents=True, exist_ok=True)
        (there / "vehicle.toml").write_text(self.vehicle)
        self.log.write_parquet(there / "log.parquet")
        if self.before is not None:
            self.before.write_parquet(there / "before.parquet")
        self.held_out.write_parquet(there / "heldout.parquet")
        facts = {
            "format": FORMAT,
            "case": self.name,
            "thrusters": sum(column.startswith("cmd_") for column in self.log.columns),
            "lead": LEAD,
            "ahead": AHEAD,
            "every": EVERY,
            "before": self.before is not None,
            "windows": self.held_out["session"].n_unique(),
        }
        (there / "case.json").write_text(json.dumps(facts, indent=1) + "\n")

    @classmethod
    def read(cls, there: Path) -> Public:
        """Read a case from its folder."""
        before = there / "before.parquet"
        return cls(
            there.name,
            (there / "vehicle.toml").read_text(),
            pl.read_parquet(there / "log.parquet"),
            pl.read_parquet(before) if before.exists() else None,
            pl.read_parquet(there / "heldout.parquet"),
        )


@dataclass(frozen=True)
class Given:
    """Answer to a case.

    Attributes:
        effects: Named effects, best first: `name`, and optionally `confidence` (0 to 1), `parameters` and
            `standard_errors`, as in an `[[effect]]` table of a vehicle file.
        seconds: Processor time [s].
        prediction: Velocities in the windows: `session`, `t` and VELOCITY, EVERY seconds after LEAD.
    """

    effects: list[dict[str, Any]]
    seconds: float
    prediction: pl.DataFrame

    def write(self, there: Path) -> None:
        """Write the answer into a folder."""
        there.mkdir(parents=True, exist_ok=True)
        self.prediction.write_parquet(there / "prediction.parquet")
        said = {"effects": self.effects, "seconds": round(self.seconds, 2)}
        (there / "answer.json").write_text(json.dumps(said, indent=1) + "\n")

    @classmethod
    def read(cls, there: Path) -> Given:
        """Read an answer from its folder.

        Raises:
            SystemExit: A file is missing or has another form.
        """
        try:
            said = json.loads((there / "answer.json").read_text())
            table = pl.read_parquet(there / "prediction.parquet").select("session", "t", *VELOCITY)
            return cls(list(said["effects"]), float(said["seconds"]), table)
        except (OSError, KeyError, TypeError, ValueError, pl.exceptions.PolarsError) as error:
            raise SystemExit(f"{there}: not an answer ({error}): see docs/challenge.md") from error


def cases(folder: Path) -> list[Path]:
    """Return the folders of all cases, in order."""
    return sorted(path.parent for path in folder.glob("*/case.json"))


def windows(held_out: pl.DataFrame, smooth: np.ndarray, dt: float, most: int) -> list[pl.DataFrame]:
    """Cut a held-out raw table into windows of LEAD and AHEAD seconds, with all their motion.

    Args:
        held_out: Raw table without gaps in its sessions.
        smooth: Smoothed motion of its rows, (N, 12).
        dt: Row interval [s].
        most: Greatest number of windows.

    Returns:
        Windows: raw tables with the smoothed motion up to LEAD, and with the logged motion after LEAD.
    """
    lead, length = round(LEAD / dt), round((LEAD + AHEAD) / dt) + 1
    numbered = held_out.with_row_index("row")
    found = []
    for part in numbered.partition_by("session", maintain_order=True):
        for begin in range(0, part.height - length + 1, length - lead):
            piece = part[begin : begin + length]
            rows = piece["row"].to_numpy()
            motion = piece.select(MOTION).to_numpy().astype(float)
            motion[: lead + 1] = smooth[rows[: lead + 1]]
            columns = {
                "session": [f"w{len(found):03d}"] * length,
                "t": np.round(np.arange(length) * dt, 6),
                **{name: motion[:, i] for i, name in enumerate(MOTION)},
                **{name: piece[name] for name in piece.columns if name.startswith("cmd_")},
            }
            found.append(pl.DataFrame(columns))
    step = max(1, len(found) // most)
    return found[::step][:most]


def blinded(whole: pl.DataFrame) -> pl.DataFrame:
    """Return windows without the motion after LEAD."""
    known = pl.col("t") <= LEAD + 1e-6
    return whole.with_columns(pl.when(known).then(pl.col(name)).alias(name) for name in MOTION)


def asked(whole: pl.DataFrame, dt: float) -> pl.DataFrame:
    """Return the rows of windows for which an answer predicts velocities: every EVERY seconds after LEAD."""
    row = ((pl.col("t") - LEAD) / dt).round().cast(pl.Int64)
    return whole.filter((row > 0) & (row % round(EVERY / dt) == 0)).select("session", "t", *VELOCITY)
