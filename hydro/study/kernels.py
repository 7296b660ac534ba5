"""Compile the kernels that most commands use: `python -m hydro.study.kernels`, as `make install` does."""

from __future__ import annotations

import time
import warnings

from hydro.core.diagnosis.diagnose import diagnose_log
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.errors import HydroNotice
from hydro.core.evaluation.compare import compare
from hydro.core.simulation.simulate import simulate
from hydro.io import table, vehicle
from hydro.io.files import bundled

SECONDS = 40.0
"""Length of the bundled recording that is diagnosed: enough for predictions 5 s ahead."""


def compile_kernels() -> float:
    """Check, compare, diagnose and simulate a bundled recording; return the time taken [s]."""
    begin, data = time.monotonic(), bundled("hidden")
    known = vehicle.read(data / "vehicle.toml")[0]
    frame = table.read(data / "measured.parquet").frame
    head = frame.filter(frame["t"] < SECONDS)
    log = preprocess(known, head)
    compare(known, log.raw, record=log.observed)
    diagnose_log(known, log)
    simulate(known, head)
    return time.monotonic() - begin


def main() -> None:
    """Compile, and say how long it took."""
    warnings.simplefilter("ignore", HydroNotice)
    print("compiling kernels for this machine, about a minute, only once", flush=True)
    print(f"compiled in {compile_kernels():.0f} s")


if __name__ == "__main__":
    main()
