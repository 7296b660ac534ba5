"""Make the cases of an edition: public files, and truths that only the scorer has."""

from __future__ import annotations

import hashlib
import io
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.challenge import seal
from benchmarks.challenge.layout import Public, asked, blinded, windows
from benchmarks.challenge.sources import SIMULATORS, Number, Source, given_values
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.recording.arrays import recording
from hydro.io import vehicle as vehicles

CASES = 60
WINDOWS = 24
"""Greatest number of windows of a case."""
Truth = dict[str, Any]


def name_of(place: int) -> str:
    """Return the name of a case."""
    return f"c{place:02d}"


def make(key: bytes, folder: Path, places: Sequence[int]) -> None:
    """Make the missing cases of an edition.

    `folder`/cases gets the files for entrants, and `folder`/truth those for the scorer.

    Args:
        key: Key of the edition.
        folder: Folder of the edition.
        places: Numbers of the cases to make.
    """
    for place in places:
        name = name_of(place)
        if not (folder / "truth" / name / "truth.json").exists():
            begun = time.process_time()
            number = Number(place, key, folder / "work")
            public, truth, motion = case(number, SIMULATORS[number.simulator](number))
            public.write(folder / "cases")
            _keep(folder / "truth" / name, truth, motion)
            print(f"{name}: made in {time.process_time() - begun:.0f} s of processor time", flush=True)
        seal.write_seals(folder / "cases", truths(folder))


def case(number: Number, source: Source) -> tuple[Public, Truth, bytes]:
    """Return a case from its source: its public files, its truth, and the sealed motion in Parquet.

    Args:
        number: Place and key of the case.
        source: Material of the case.
    """
    name = name_of(number.place)
    vehicle = vehicles.parse(source.vehicle)
    record = recording(vehicle, source.held_out)
    motion = Motion.of(record)
    whole = pl.concat(windows(source.held_out, np.hstack([motion.eta, motion.nu]), record.dt, WINDOWS))
    sealed = _parquet(asked(whole, record.dt))
    truth: Truth = {
        "case": name,
        "simulator": number.simulator,
        "title": source.title,
        "called": list(source.called),
        "alias": list(source.alias),
        "values": {effect: dict(table) for effect, table in source.values.items()},
        "given": {effect: given_values(source.vehicle, effect) for effect in source.values},
        "gyradius": _gyradius(vehicle.rigid_body.mass, vehicle.rigid_body.inertia),
        "motion": hashlib.sha256(sealed).hexdigest(),
        "salt": seal.salt(number.key, name),
    }
    return Public(name, source.vehicle, source.log, source.before, blinded(whole)), truth, sealed


def truths(folder: Path) -> dict[str, Truth]:
    """Return the truths of all cases that exist."""
    return {
        path.parent.name: json.loads(path.read_text())
        for path in sorted((folder / "truth").glob("*/truth.json"))
    }


def opened(folder: Path, name: str) -> tuple[Truth, pl.DataFrame]:
    """Return the truth and the sealed motion of a case, after a comparison with its seal.

    Raises:
        SystemExit: Truth or motion differ from those that were sealed.
    """
    there = folder / "truth" / name
    truth = json.loads((there / "truth.json").read_text())
    content = (there / "motion.parquet").read_bytes()
    if seal.sealed(truth) != seal.read_seals(folder / "cases").get(name):
        raise SystemExit(f"{there}/truth.json: not the sealed truth: restore it")
    if hashlib.sha256(content).hexdigest() != truth["motion"]:
        raise SystemExit(f"{there}/motion.parquet: not the sealed motion: restore it")
    return truth, pl.read_parquet(io.BytesIO(content))


def _keep(there: Path, truth: Mapping[str, Any], motion: bytes) -> None:
    """Write the sealed motion and then the truth of a case; `truth.json` marks the case as complete."""
    there.mkdir(parents=True, exist_ok=True)
    (there / "motion.parquet").write_bytes(motion)
    (there / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


def _parquet(table: pl.DataFrame) -> bytes:
    sink = io.BytesIO()
    table.write_parquet(sink)
    return sink.getvalue()


def _gyradius(mass: float, inertia: Any) -> list[float]:
    """Return the radii of gyration (3,) [m], with which errors of rates count as errors of velocity."""
    return [float(np.sqrt(np.array(inertia)[i, i] / mass)) for i in range(3)]
