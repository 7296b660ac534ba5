"""Regression of the residual wrench on the Stonefish recordings, and excerpts of them for `hydro explain`.

    # Label the recording:
    hydro labels nominal.parquet --vehicle datasets/stonefish/vehicle.toml -o labels.parquet
    # Fit the labels, and cut the excerpts:
    python -m benchmarks.stonefish [RECORDINGS] --labels labels.parquet --excerpts FOLDER

RECORDINGS is the folder of nominal.parquet, v1_current.parquet and v3_thruster3.parquet; by default that of
the installed distribution deep-hydro-sim-data (`hydro data path`).  FOLDER gets five excerpts: four minutes
of `nominal`, ten minutes before a change (before.parquet), four minutes of its other sessions
(held_out.parquet), and four minutes of each changed vehicle.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np
import polars as pl

from benchmarks.full_recordings import folder_of

EVERY = 37  # step between the label rows that are used


def terms(labels: pl.DataFrame) -> None:
    """Print the shares of the residual wrench explained by damping of its axis and by all products."""
    frame = labels.gather_every(EVERY)
    nu = frame.select("u_s", "v_s", "w_s", "p_s", "q_s", "r_s").to_numpy().astype(float)
    products = [nu[:, i] * nu[:, j] for i, j in itertools.combinations_with_replacement(range(6), 2)]
    drags = [np.abs(nu[:, i]) * nu[:, j] for i in range(6) for j in range(6)]
    every = np.column_stack([nu, *drags, *products])
    names = [f"abs({a}) {b}" for a in "uvwpqr" for b in "uvwpqr"]
    for axis, name in enumerate("XYZKMN"):
        wrench, own = frame[f"{name}_res"].to_numpy().astype(float), nu[:, axis]
        alone, _ = explained(np.column_stack([own, np.abs(own) * own]), wrench)
        share, amounts = explained(every, wrench)
        size = np.abs(amounts[6:42] * np.std(drags, axis=1))
        most = ", ".join(f"{amounts[6 + i]:.3g} {names[i]}" for i in np.argsort(-size)[:4])
        print(f"{name}: own damping {alone:.3f}, all products {share:.3f}; {most}")


def explained(columns: np.ndarray, wanted: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the R^2 of a least-squares fit, and its coefficients."""
    amounts = np.linalg.lstsq(columns, wanted, rcond=None)[0]
    return 1.0 - float(
        ((wanted - columns @ amounts) ** 2).sum() / ((wanted - wanted.mean()) ** 2).sum()
    ), amounts


def heads(path: Path, sessions: int, rows: int, *, between: bool = False) -> pl.DataFrame:
    """Return the first `rows` rows, with rotors at rest, of `sessions` evenly spread sessions.

    With `between`, the sessions are those between the evenly spread ones.
    """
    raw = pl.read_parquet(path)
    names = raw["session"].unique(maintain_order=True)
    places = (np.arange(sessions) + 0.5 * between) * len(names) / sessions
    return pl.concat([raw.filter(session=names[int(i)]).head(rows) for i in places])


def excerpts(recordings: Path, folder: Path) -> None:
    """Write the inputs of the studies in docs/benchmarks.md."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, rows in (("nominal", 1000), ("before", 2500)):
        heads(recordings / "nominal.parquet", 12, rows).write_parquet(folder / f"{name}.parquet")
    heads(recordings / "nominal.parquet", 12, 1000, between=True).write_parquet(folder / "held_out.parquet")
    for name, sessions, rows in (("v1_current", 11, 1000), ("v3_thruster3", 9, 1200)):
        heads(recordings / f"{name}.parquet", sessions, rows).write_parquet(folder / f"{name}.parquet")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", type=Path, nargs="?", help="by default the installed ones")
    parser.add_argument("--labels", type=Path, help="labels of nominal.parquet; no regression without them")
    parser.add_argument("--excerpts", type=Path, metavar="FOLDER", help="folder for the excerpts")
    chosen = parser.parse_args()
    if chosen.labels:
        terms(pl.read_parquet(chosen.labels))
    if chosen.excerpts:
        excerpts(folder_of(chosen.recordings), chosen.excerpts)


if __name__ == "__main__":
    main()
