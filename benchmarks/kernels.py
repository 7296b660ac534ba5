"""Compile the kernels of the benchmarks' own simulator, as `make install` does for their tests.

python -m benchmarks.kernels
"""

from __future__ import annotations

import numpy as np

from benchmarks.flown_advice.cases import Sea
from benchmarks.hidden_effects import cases, vehicles
from benchmarks.hidden_effects.build import build
from benchmarks.hidden_effects.flights import DT, independent
from benchmarks.hidden_effects.plant import BODY
from benchmarks.imperfect_logs import closed_loop
from benchmarks.rivals.output_error import predict

ROWS = 50
"""Rows of each flight: any number compiles."""


def main() -> None:
    """Fly one vehicle under demanded wrenches, under feedback and under commands, and predict its motion."""
    case, known = cases.draw("none", 0), vehicles.preset("bluerov2_heavy")
    how = {"rows": [ROWS], "depth": 10.0, "noise": 0.0, "seed": 0}
    independent(known, known, [], {}, **how)
    list(closed_loop.sessions(known, known, [], closed_loop.STATION, **how))
    commands, first = np.zeros((ROWS, len(known.thruster))), np.eye(BODY)[3]
    Sea(case, known).fly("rest", [commands], np.zeros(6))
    predict(build(known), first[None], np.zeros(1, np.int64), commands, ROWS, DT)


if __name__ == "__main__":
    main()
