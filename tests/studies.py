"""A small study made up for tests: tables that keep their schemas, with numbers easy to find again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl

from hydro.core.diagnosis.findings import Diagnosis, Finding
from hydro.io import table, vehicle
from hydro.io.table import Artefact

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "datasets" / "stonefish" / "vehicle.toml").read_text()
CURRENT = {"name": "ocean_current", "v_N": 0.26, "v_E": 0.24, "v_D": 0.0}
UNITS = {**dict.fromkeys("XYZ", "N"), **dict.fromkeys("KMN", "N m"), **dict.fromkeys("uvw", "m/s")}
UNITS |= {**dict.fromkeys("pqr", "rad/s"), "all": "m/s", "pose": "m"}


def comparison(scale: float = 1.0, worst: str = "while turning right above 0.8 m/s") -> pl.DataFrame:
    """A comparison whose velocity errors 5 s ahead are 2 m/s times `scale`; 60 % lie in one place on sway."""

    def line(level: str, horizon: float | None, axis: str, by: str, place: str, rmse: float, **more: object):
        unit = "N" if level == "force" and axis == "all" else UNITS[axis]
        interval = {"rmse": rmse, "low": 0.8 * rmse, "high": 1.3 * rmse, "noise_floor": 0.01, "unit": unit}
        key = {"level": level, "horizon": horizon, "axis": axis, "by": by, "place": place, "rows": 900}
        return key | interval | {"at_horizon": None, "share": 0.1, "rank": None} | more

    rows = [line("force", None, axis, "all", "all", 50.0 * scale, rows=1000) for axis in (*"XYZKMN", "all")]
    for number, words in enumerate(("below 0.4 m/s", "above 0.4 m/s")):
        rows += [line("force", None, a, "speed", words, 30.0 * scale + number) for a in (*"XYZKMN", "all")]
    for horizon in (1.0, 5.0, None):
        error = 0.4 * scale * (horizon or 20.0)
        rows += [line("replay", horizon, axis, "all", "all", error) for axis in (*"uvwpqr", "all", "pose")]
    rows += [
        line("force", None, "Y", "place", worst, 90.0 * scale, rows=200, share=0.6, rank=1),
        line("force", None, "X", "place", "in all motion", 20.0 * scale, rows=1000, share=0.25, rank=2),
    ]
    return pl.DataFrame(
        rows, schema_overrides={"horizon": pl.Float64, "rank": pl.Int64, "at_horizon": pl.Float64}
    )


FOUND_CURRENT = Finding(
    "missing",
    "ocean_current",
    ("ocean_current", "tether"),
    share=0.41,
    low=0.33,
    high=0.52,
    confidence=0.93,
    p_value=0.0005,
    parameters={"v_N": 0.26, "v_E": 0.24, "v_D": 0.0},
    standard_errors={"v_N": 0.012, "v_E": 0.013, "v_D": 0.01},
    advice="add it with `hydro add`",
)


def found() -> pl.DataFrame:
    """A diagnosis with a finding of every verdict that stands beside others."""
    findings = (
        FOUND_CURRENT,
        Finding(
            "cannot_tell_apart",
            "thruster_gain",
            ("thruster_gain", "quadratic_damping"),
            share=0.2,
            parameters={"g": [0.0, 0.0, -0.4, 0.0, 0.0, 0.0, 0.0]},
            advice="to separate them: fly a powered step",
        ),
        Finding("retune", "linear_damping", parameters={"diagonal": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]}),
        Finding("none_of_the_known", share=0.07, advice="it grows with depth: fly deeper"),
        Finding("not_excited", "surface_suction", ("surface_suction",), excited=False, advice="fly shallow"),
    )
    return Diagnosis(findings, vehicle.parse(TEXT), (9.0, 4.0, 1.1)).frame()


def nothing() -> pl.DataFrame:
    """A diagnosis that found nothing."""
    return Diagnosis((Finding("nothing_missing"),), vehicle.parse(TEXT), (1.0, 1.0, 1.0)).frame()


def ladder() -> pl.DataFrame:
    """Two steps on fitted and held-out data: 2.0 to 0.2 m/s and 1.8 to 0.3 m/s, 5 s ahead."""
    errors = {("fit", 0): 2.0, ("fit", 1): 0.2, ("holdout", 0): 1.8, ("holdout", 1): 0.3}
    rows = [
        {
            "step": step,
            "effect": "ocean_current" if step else "",
            "dataset": dataset,
            "axis": axis,
            "horizon": horizon,
            "rmse": error * (horizon or 20.0) / 5.0,
            "low": 0.8 * error,
            "high": 1.2 * error * (horizon or 20.0) / 5.0,
            "noise_floor": 0.02,
            "unit": UNITS[axis],
        }
        for (dataset, step), error in errors.items()
        for horizon in (1.0, 5.0, None)
        for axis in (*"uvwpqr", "all", "pose")
    ]
    return pl.DataFrame(rows, schema_overrides={"horizon": pl.Float64})


def leftover() -> pl.DataFrame:
    """On every axis a fifth of the file's own drag -100 v before, nothing after; of six blocks each."""
    lines = []
    for step, share in ((0, 0.2), (1, 0.0)):
        for axis, against in zip("XYZKMN", "uvwpqr", strict=True):
            for v in (-0.8, -0.4, 0.0, 0.4, 0.8):
                units = {"unit": UNITS[axis], "velocity_unit": UNITS[against]}
                key = {"step": step, "axis": axis, "against": against, "velocity": v, "model": -100.0 * v}
                force = -share * 100.0 * v
                told = {"force": force, "low": force - 1.0, "high": force + 1.0, "rows": 90, "blocks": 6.0}
                lines.append(key | told | units)
                lines.append(key | dict.fromkeys(("force", "low", "high", "blocks")) | {"rows": 0} | units)
    return pl.DataFrame(lines, infer_schema_length=None)


def sessions() -> pl.DataFrame:
    """Two sessions of 4 min that were fitted to at 20 Hz, and one of 90 s at 10 Hz that was not."""
    rows = [("fit", "run-1", 4800, 0.05), ("fit", "run-2", 4800, 0.05), ("holdout", "run-3", 900, 0.1)]
    return pl.DataFrame(rows, schema=["dataset", "session", "rows", "sample_time"], orient="row")


def replay(variants: tuple[str, ...] = ("measured", "step-0", "step-1")) -> pl.DataFrame:
    """Two sessions of a slow sine and commands; a later variant is off by 0.1 less than the one before."""
    t = np.arange(400) * 0.05
    columns = ["x", "y", "z", "phi", "theta", "psi", *"uvwpqr"]
    return pl.concat(
        pl.DataFrame({"t": t} | {name: np.sin(0.3 * t) * 0.5 + offset for name in columns}).select(
            pl.lit(session).alias("session"),
            pl.lit(variant).alias("variant"),
            pl.all(),
            *(
                pl.lit(0.1 * i if variant == "measured" else None, pl.Float64).alias(f"cmd_{i}")
                for i in range(1, 9)
            ),
        )
        for session in ("run-1", "run-2")
        for variant, offset in zip(variants, (0.0, 0.2, 0.1), strict=False)
    )


def metrics() -> pl.DataFrame:
    """Errors of two variants of a replay."""
    return pl.DataFrame(
        [
            {
                "model": name,
                "variant": name,
                "dataset": "replay90",
                "axis": axis,
                "metric": "rmse",
                "value": value * (k + 1),
                "low": None,
                "high": None,
                "unit": UNITS[axis],
            }
            for name, value in (("MJ0", 1.25), ("MJ4", 0.01))
            for k, axis in enumerate("uvwpqr")
        ],
        schema_overrides={"low": pl.Float64, "high": pl.Float64},
    )


def artefacts() -> dict[str, Artefact]:
    """All files of the study but the vehicles', by their names."""
    better = vehicle.set_effect(TEXT, CURRENT | {"standard_error": {"v_N": 0.012, "v_E": 0.013, "v_D": 0.01}})

    def made(kind: str, frame: pl.DataFrame, text: str = TEXT) -> Artefact:
        return table.make(kind, frame, stage="explain", vehicle_text=text)

    return {
        "comparison-0.parquet": made("comparison", comparison()),
        "comparison-1.parquet": made("comparison", comparison(0.1, "while braking"), better),
        "diagnosis-0.parquet": made("diagnosis", found()),
        "diagnosis-1.parquet": made("diagnosis", nothing(), better),
        "ladder.parquet": made("ladder", ladder()),
        "leftover.parquet": made("leftover", leftover()),
        "sessions.parquet": made("sessions", sessions()),
        "replay.parquet": made("replay", replay()),
    }


def write(folder: Path) -> Path:
    """The study as files."""
    for name, artefact in artefacts().items():
        table.write(artefact, folder / name)
    return folder
