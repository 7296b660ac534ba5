"""Draw docs/images/proof.png from the kept tables of `benchmarks.proof`; `make docs` runs it."""

from __future__ import annotations

import runpy
from pathlib import Path

import polars as pl

from hydro.report.proof import PILOT, Shown, draw
from hydro.report.training import save
from hydro.study.proof_tables import pooled

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "images" / "proof.png"
kept = runpy.run_path(str(Path(__file__).with_name("generate_benchmarks.py")))["results"]
"""Function from the name of a kept table to its rows, with cells as text."""


def number(text: str) -> float | None:
    """Return the number of a cell; None of an empty one."""
    return float(text) if text else None


def shown(change: str) -> Shown:
    """Return the results of one change, by the title in the kept tables."""
    errors, named, flights = (
        [row for row in kept(f"proof_{name}") if row["change"] == change]
        for name in ("errors", "named", "flights")
    )
    numbers = ("given", "found", "low", "high", "true")
    flown = pl.DataFrame(
        {
            "flown_by": row["flown by"],
            "file": "before" if row["flown by"] == PILOT else row["trained"],
            "vehicle": row["vehicle"],
            "episodes": int(row["episodes"]),
            "success": float(row["arrived"]),
        }
        for row in flights
        if row["arrived"]
    )
    return Shown(
        pl.DataFrame({"method": row["method"], "error": number(row["error [m/s]"])} for row in errors),
        pl.DataFrame(
            [{"value": row["value"]} | {key: number(row[key]) for key in numbers} for row in named],
            schema={"value": pl.String} | dict.fromkeys(numbers, pl.Float64),
        ),
        pooled(flown),
        flown,
        [row["method"] for row in errors if row["method"].startswith("step ")],
        [f"{row['method']} ({row['note']})" for row in errors if not row["error [m/s]"]],
    )


def main() -> None:
    """Draw the picture, a row for every change."""
    changes = dict.fromkeys(row["change"] for row in kept("proof_errors"))
    save(draw({change: shown(change) for change in changes}), PICTURE)


if __name__ == "__main__":
    main()
