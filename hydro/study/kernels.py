"""Compile the kernels that most commands use: `python -m hydro.study.kernels`, as `make install` does."""

from __future__ import annotations

import contextlib
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import polars as pl

from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.pipeline import diagnose_log
from hydro.core.distillation.labels import labels
from hydro.core.distillation.labels_of_samples import labels_of_samples
from hydro.core.distillation.split import split
from hydro.core.errors import HydroNotice
from hydro.core.evaluation.compare import compare
from hydro.core.extras import MissingExtraError
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.io import table, vehicle
from hydro.io.files import bundled

SECONDS = 40.0
"""Length of the bundled recording that is diagnosed: enough for predictions 5 s ahead."""


def compile_diagnosis(seconds: float = SECONDS) -> None:
    """Compile the kernels of checks, comparison, diagnosis and simulation, with `seconds` of a recording."""
    known, head = _recorded(seconds)
    log = preprocess(known, head)
    compare(known, log.raw, record=log.observed)
    diagnose_log(known, log)
    simulate(known, head)


def compile_network(seconds: float = SECONDS) -> None:
    """Compile the kernels of labels, training and MuJoCo simulation, with `seconds` of a bundled recording.

    Without torch no network is trained, and the vehicle is simulated without one.
    """
    from hydro.sim.replay import replay, variants

    known, head = _recorded(seconds)
    labels_of_samples(known, head)
    models = []
    with contextlib.suppress(MissingExtraError):
        from hydro.learn.train import train

        models.append(train(split(labels(known, head))[0], model="physfeat", epochs=1))
    replay(known, head, variants(models))
    labels(known, head, subtract="effects")


def compile_kernels(seconds: float = SECONDS) -> float:
    """Compile all kernels, two processes at a time; return the time that this took [s]."""
    begin = time.monotonic()
    with ProcessPoolExecutor(2, mp_context=get_context("spawn"), initializer=_quiet) as pool:
        for done in [pool.submit(work, seconds) for work in (compile_diagnosis, compile_network)]:
            done.result()
    return time.monotonic() - begin


def _recorded(seconds: float) -> tuple[Vehicle, pl.DataFrame]:
    """Return a bundled vehicle file and the first `seconds` of its recording (raw table)."""
    data = bundled("hidden")
    frame = table.read(data / "measured.parquet").frame
    return vehicle.read(data / "vehicle.toml")[0], frame.filter(frame["t"] < seconds)


def _quiet() -> None:
    """Switch off the notices of compilations."""
    warnings.simplefilter("ignore", HydroNotice)


def main(seconds: float = SECONDS) -> None:
    """Compile all kernels with `seconds` of a bundled recording, and print how long that took."""
    print("compiling kernels for this machine, about a minute, only once", flush=True)
    print(f"compiled in {compile_kernels(seconds):.0f} s")


if __name__ == "__main__":
    main()
