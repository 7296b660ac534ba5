"""What drag leaves unexplained on the Stonefish recordings, and what diagnose says of two changed vehicles.

    hydro labels nominal.parquet --vehicle datasets/stonefish/vehicle.toml -o labels.parquet
    python benchmarks/stonefish.py RECORDINGS --labels labels.parquet

RECORDINGS is the folder of nominal.parquet, v1_current.parquet and v3_thruster3.parquet.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np
import polars as pl

from hydro.core import search
from hydro.core.diagnose import aimed, diagnose
from hydro.core.fit import judged
from hydro.core.recording import recording
from hydro.core.vehicle import Vehicle
from hydro.io import vehicle as files

VEHICLE = Path(__file__).parents[1] / "datasets" / "stonefish" / "vehicle.toml"
EFFECTS = (
    "linear_damping",
    "quadratic_damping",
    "crossflow_drag",
    "added_mass_coriolis",
    "body_lift",
    "coupled_damping",
)
BEGIN = {"name": "linear_damping", "diagonal": [240.0, 260.0, 320.0, 20.0, 50.0, 40.0]}
EVERY = 37  # rows of the labels from one that is used to the next


def terms(labels: pl.DataFrame) -> None:
    """Share of the residual wrench that its own axis' damping explains, and all products of velocities."""
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
    """R^2 of a least-squares fit, and its amounts."""
    amounts = np.linalg.lstsq(columns, wanted, rcond=None)[0]
    return 1.0 - float(
        ((wanted - columns @ amounts) ** 2).sum() / ((wanted - wanted.mean()) ** 2).sum()
    ), amounts


def heads(path: Path, sessions: int, rows: int) -> pl.DataFrame:
    """The first `rows` rows, ten seconds in, of sessions spread over a recording."""
    raw = pl.read_parquet(path)
    names = raw["session"].unique(maintain_order=True)
    chosen = [names[int(i * len(names) / sessions)] for i in range(sessions)]
    return pl.concat([raw.filter(session=name).slice(500, rows) for name in chosen])


def damped(folder: Path) -> Vehicle:
    """The vehicle file with the usual damping, fitted to 240 s of the nominal sessions."""
    vehicle, _ = files.read(VEHICLE)
    record = recording(heads(folder / "nominal.parquet", 12, 1000), vehicle)
    begun = search.free(vehicle, [BEGIN]).at(np.array(BEGIN["diagonal"]))
    model = search.fitted(begun, EFFECTS, aimed(begun, record), record.eta[:, :3], 12)
    print(f"damping fitted: mean squared residual {model.normal.chi2:.4g}")
    return judged(model.unknown, model.values, model.normal, model.normal.chi2, "output").vehicle


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", type=Path)
    parser.add_argument("--labels", type=Path, help="of nominal.parquet; without, no regression")
    chosen = parser.parse_args()
    if chosen.labels:
        terms(pl.read_parquet(chosen.labels))
    vehicle = damped(chosen.recordings)
    for name, sessions, rows in (("v1_current", 11, 1000), ("v3_thruster3", 9, 1200)):
        found = diagnose(vehicle, heads(chosen.recordings / f"{name}.parquet", sessions, rows))
        print(f"{name}: mean squared residual {', '.join(f'{value:.4g}' for value in found.chi2)}")
        for one in found.findings:
            if one.verdict != "not_excited":
                print(f"  {one.verdict} {one.effect} {one.share:.2f} {dict(one.parameters)}")


if __name__ == "__main__":
    main()
