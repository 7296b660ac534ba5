"""Make the cases of a seed as files.

    python -m benchmarks.apart make 1 cases/

The same command continues where an earlier one stopped; a seed takes some twenty minutes on one core.  The
lists `apart-before` and `apart-plain` of `benchmarks.judge` make and diagnose the cases that they need.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # threads of matrices this small only wait for one another

import argparse
from pathlib import Path

from benchmarks.apart.cases import CASES
from benchmarks.apart.make import make


def main() -> None:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.apart", description=about)
    commands = top.add_subparsers(required=True)
    names = [case.name for case in CASES]
    one = commands.add_parser("make", help="make the cases of a seed")
    one.add_argument("seed", type=int)
    one.add_argument("folder", type=Path, help="that gets a folder per case")
    one.add_argument("--only", nargs="+", default=[], choices=names, metavar="NAME", help="some cases")
    chosen = top.parse_args()
    make(chosen.seed, chosen.folder, chosen.only)


if __name__ == "__main__":
    main()
