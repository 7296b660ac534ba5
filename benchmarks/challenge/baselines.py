"""Baselines: the answers of each method of the leaderboard to a case."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.challenge.layout import EVERY, LEAD, MOTION, VELOCITY, Given, Public
from benchmarks.rivals.contest import Held, answer_of, by_vehicle
from hydro.core.diagnosis.findings import WITH_VALUES, Finding, extended
from hydro.core.diagnosis.pipeline import diagnose
from hydro.core.evaluation import yardsticks
from hydro.core.recording.arrays import recording
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as vehicles

Answered = tuple[list[dict[str, Any]], np.ndarray]
"""Named effects, and velocities (S, L, 6) in all windows."""
ADDED = ("missing", "retune")
"""Verdicts that are added to the file before it predicts."""


def run(name: str, there: Path, out: Path) -> float:
    """Answer a case with a baseline, and write the answer.

    Args:
        name: Name of the baseline.
        there: Folder of the case.
        out: Folder of the entry.

    Returns:
        Processor time [s].

    Raises:
        SystemExit: A package of the baseline is not installed.
    """
    public = Public.read(there)
    vehicle = vehicles.parse(public.vehicle)
    held = held_of(vehicle, public.held_out)
    begun = time.process_time()
    try:
        effects, velocities = BASELINES[name](vehicle, public, held)
    except ImportError as missing:
        raise SystemExit(
            f"{name}: {missing.name} is not installed: install it, or leave out {name}"
        ) from missing
    except Exception as error:  # a failed method names nothing and predicts nothing
        print(f"{name}, {public.name}: {type(error).__name__}: {error}", flush=True)
        effects, velocities = [], np.full((held.starts.size, held.length, 6), np.nan)
    spent = time.process_time() - begun
    Given(effects, spent, table_of(public.held_out, velocities, held)).write(out / public.name)
    return spent


def held_of(vehicle: Vehicle, held_out: pl.DataFrame) -> Held:
    """Return the held-out windows of a case as a recording with the starts of predictions.

    Rows after LEAD have no motion; they repeat the last known state and are not used.
    """
    whole = held_out.with_columns(pl.col(name).forward_fill().over("session") for name in MOTION)
    record = recording(vehicle, whole)
    starts = record.segments[:, 0] + round(LEAD / record.dt)
    return Held(record, record.eta, record.nu, starts, whole)


def table_of(held_out: pl.DataFrame, velocities: np.ndarray, held: Held) -> pl.DataFrame:
    """Return predicted velocities as the table of an answer.

    Args:
        held_out: Windows of the case.
        velocities: Predicted velocities of S windows and L rows (S, L, 6) [m/s, rad/s].
        held: The windows as a recording.
    """
    step = round(EVERY / held.record.dt)
    names = held_out["session"].unique(maintain_order=True).to_list()
    parts = []
    for name, each in zip(names, velocities, strict=True):
        rows = np.arange(step, len(each), step)
        columns = {"session": [name] * rows.size, "t": np.round(LEAD + rows * held.record.dt, 6)}
        parts.append(pl.DataFrame(columns | {axis: each[rows, i] for i, axis in enumerate(VELOCITY)}))
    return pl.concat(parts)


def as_given(vehicle: Vehicle, public: Public, held: Held) -> Answered:
    """Answer without a name, and predict with the vehicle file as given."""
    return [], by_vehicle(vehicle, held)


def least_squares(vehicle: Vehicle, public: Public, held: Held) -> Answered:
    """Answer without a name; predict with damping, cross terms and delayed thrust fitted to each axis."""
    fitted = yardsticks.Yardstick.of(vehicle, public.log).of_others
    rows = held.starts[:, None] + np.arange(held.length)
    tau = yardsticks._wrench(vehicle, held.record)
    return [], fitted._by_least_squares(held.record, held.starts, rows, held.nu[held.starts], tau)


def hydro(vehicle: Vehicle, public: Public, held: Held) -> Answered:
    """Answer with hydro's diagnosis, and predict with the confirmed effects added.

    The diagnosis uses the earlier log of the case if there is one.
    """
    found = diagnose(vehicle, public.log, before=public.before)
    stated = [one for one in found.findings if one.verdict in ADDED and one.parameters]
    model = extended(vehicle, [one.table for one in stated])
    return [_told(one) for one in found.findings if one.verdict in WITH_VALUES], by_vehicle(model, held)


def _told(one: Finding) -> dict[str, Any]:
    """Return a finding in the form of an answer."""

    def plain(values: Mapping[str, Any]) -> dict[str, Any]:
        return {key: np.asarray(value).tolist() for key, value in values.items()}

    return {
        "name": one.effect.split(":")[0],
        "confidence": float(np.nan_to_num(one.confidence)),
        "parameters": plain(one.parameters),
        "standard_errors": plain(one.standard_errors),
    }


def network(vehicle: Vehicle, public: Public, held: Held) -> Answered:
    """Answer without a name, and predict with a network trained on the log; it needs torch."""
    from benchmarks.challenge.network import of_network

    return of_network(vehicle, public, held)


def by_rival(module: str) -> Callable[[Vehicle, Public, Held], Answered]:
    """Return the baseline of a rival method in a module of `benchmarks.rivals`.

    It sees the log alone and names one effect without a confidence.
    """

    def answer(vehicle: Vehicle, public: Public, held: Held) -> Answered:
        found = answer_of(module)(vehicle, public.log)
        return [{"name": found.name}] if found.name else [], found.predict(held)

    return answer


BASELINES: Mapping[str, Callable[[Vehicle, Public, Held], Answered]] = {
    "file as given": as_given,
    "least squares": least_squares,
    "PySINDy": by_rival("sindy"),
    "network": network,
    "scipy output error": by_rival("output_error"),
    "mujoco.sysid": by_rival("mujoco_sysid"),
    "hydro": hydro,
}
"""Baselines by the name of their entry, the quickest first."""
