"""Compare networks, identified effects and simple predictors: fluid memory, three vehicles, a real recording.

    # Fluid memory in the reference simulator; then three vehicles.
    python -m benchmarks.future_work run memory -o future
    python -m benchmarks.future_work run vehicles -o future
    # A real recording that you have: fit.csv, hold.csv, map.toml and vehicle2.toml in FOLDER.
    python -m benchmarks.future_work run recorded --logs FOLDER -o future
    # Keep the tables.
    python -m benchmarks.future_work keep COMMIT -o future

A part continues where an earlier run stopped.  No recording is bundled or kept.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # threads of matrices this small only wait for one another

import argparse
from pathlib import Path

from benchmarks.future_work.recordings import cases
from benchmarks.future_work.study import SCHEMA, SEEDS, Chosen, run
from benchmarks.future_work.tables import keeps
from benchmarks.work import Results

PARTS = ("memory", "vehicles", "recorded")


def main() -> None:
    top = argparse.ArgumentParser(
        prog="python -m benchmarks.future_work",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = top.add_subparsers(required=True, dest="command")
    one = commands.add_parser("run", help="measure the models of a part")
    one.add_argument("part", choices=PARTS)
    one.add_argument("--logs", type=Path, help="folder of the real recording, for part recorded")
    one.add_argument("--explained", type=Path, help="vehicle file of `hydro explain` for that recording")
    one.add_argument("--seeds", type=int, default=SEEDS, help="trainings of each network")
    one.add_argument("--as-given", action="store_true", help="train networks with the file's added mass")
    kept = commands.add_parser("keep", help="keep the tables in benchmarks/results")
    kept.add_argument("commit", help="commit of the measured code")
    for parser in (one, kept):
        parser.add_argument("-o", "--out", type=Path, default=Path("future"), help="folder of the results")
    chosen = top.parse_args()
    results = Results(chosen.out / "errors.parquet", SCHEMA)
    if chosen.command == "keep":
        keeps(results.table, chosen.commit)
        return
    for case in cases(chosen.part, chosen.logs, chosen.explained):
        run(case, results, Chosen(chosen.out, chosen.seeds, chosen.as_given))


if __name__ == "__main__":
    main()
