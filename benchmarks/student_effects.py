"""Cost of effects in MuJoCo: steps per second of processor time with 20 effects, as shares of bare MuJoCo.

`auv151` with the effects of its file, and with 20 effects of the catalogue, 64 vehicles, one thread, 500 Hz,
implicitfast.  A round times every case once, in alternating order.  The last part times the wrench alone, of
each effect by itself, without the loop that calls it.

    python benchmarks/student_effects.py --keep student_effects
"""

from __future__ import annotations

import argparse
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numba
import numpy as np
from kept_tables import keep_timed
from student import (
    TIMESTEP,
    VEHICLES,
    Clock,
    Rows,
    bare,
    interleaved,
    rate,
    side_by_side,
    silenced,
)

from hydro.core.columns import Array
from hydro.core.effects import assemble, layout
from hydro.core.effects.program import relative_to_water, start, wrench
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files
from hydro.sim.bridge import mjcf, native
from hydro.sim.bridge.water import wet

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "sim"))

from effects import EFFECTS  # values of all effects, shared with the tests

COUNT, CALLS = 64, 20_000
TWENTY = (
    "added_mass", "added_mass_coriolis", "linear_damping", "quadratic_damping", "coupled_damping",
    "crossflow_drag", "cross_axis_drag", "power_drag", "offset_drag", "control_surface", "body_lift",
    "net_buoyancy", "buoyancy_offset", "payload", "ocean_current", "drifting_ballast", "tether",
    "surface_suction", "fluid_memory", "formula",
)  # fmt: skip
STATES = ("drifting_ballast", "fluid_memory")
HEAVY = ("crossflow_drag", "power_drag", "control_surface", "formula")
"""Effects that take powers, angles or strips of the hull."""


def with_effects(vehicle: Vehicle, names: tuple[str, ...]) -> Vehicle:
    """Return the vehicle with the named effects in place of its own."""
    return msgspec.structs.replace(vehicle, effect=tuple({"name": name, **EFFECTS[name]} for name in names))


def in_mujoco(vehicle: Vehicle, rounds: int, seconds: float) -> Rows:
    """Return rows of the cases: time of a step, and share of bare MuJoCo's speed."""
    light = tuple(name for name in TWENTY if name not in HEAVY)
    subjects = {
        "effects of the file": vehicle,
        "20 effects": with_effects(vehicle, TWENTY),
        "16 of them, without powers, angles and strips": with_effects(vehicle, light),
        "14 of those, without internal states": with_effects(
            vehicle, tuple(name for name in light if name not in STATES)
        ),
    }
    works = {"bare": partial(silenced, side_by_side(bare(vehicle), COUNT, 1))}
    for name, subject in subjects.items():
        model = native.prepare(mjcf.scene(subject, wet(subject), timestep=TIMESTEP).compile())
        works[name] = partial(rate, side_by_side(model, COUNT, 1))
    found = interleaved(works, rounds, seconds)
    rows: Rows = []
    for name, rates in found.items():
        low, ratio, high = np.quantile(rates / found["bare"], [0.25, 0.5, 0.75])
        rows.append(
            {
                "case": name,
                "time of a step, ns": f"{1e9 / np.median(rates):,.0f}",
                "share of bare MuJoCo's speed": f"{ratio:.2f} [{low:.2f}, {high:.2f}]",
            }
        )
    return rows


@numba.njit  # type: ignore[untyped-decorator]
def repeated(calls: int, flat: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Compute the wrench of a compiled vehicle several times.

    Args:
        calls: Number of computations.
        flat: Program of the vehicle.
        s: State of motion.
        x: States of the effects.
        dx: Buffer for the rates of these states.
        tau: Buffer for the wrench (6,).
    """
    for _ in range(calls):
        tau[:] = 0.0
        wrench(flat, s, x, dx, tau)


def alone(vehicle: Vehicle) -> float:
    """Return the time of a wrench of all effects of a vehicle [ns]."""
    program = assemble(vehicle)
    s, x, tau = np.zeros(layout.MOTION), np.zeros(program.states), np.zeros(6)
    s[layout.ROTATION : layout.ROTATION + 9] = np.eye(3).ravel()
    s[layout.POSITION + 2] = 3.0
    s[layout.VELOCITY : layout.VELOCITY + 6] = 0.5, -0.3, 0.2, 0.1, -0.2, 0.3
    s[layout.COMMANDS : layout.COMMANDS + 8] = 0.3
    relative_to_water(program.flat, s)
    start(program.flat, s, x)
    times = []
    for _ in range(6):
        begun = time.process_time()
        repeated(CALLS, program.flat, s, x, np.zeros_like(x), tau)
        times.append(1e9 * (time.process_time() - begun) / CALLS)
    return float(np.median(times[1:]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--seconds", type=float, default=0.1, help="of every case in every round")
    parser.add_argument("--keep", metavar="NAME", help="write benchmarks/results/NAME.csv")
    parser.add_argument("--commit", default="", help="measured commit, for --keep")
    chosen = parser.parse_args()
    Clock.of_the_processor()
    vehicle = files.read(VEHICLES / "auv151.toml")[0]
    rows: list[dict[str, Any]] = in_mujoco(vehicle, chosen.rounds, chosen.seconds)
    loop = alone(with_effects(vehicle, ()))
    groups = {"20 effects": TWENTY} | {name: (name,) for name in HEAVY}
    for name, effects in groups.items():
        spent = alone(with_effects(vehicle, effects)) - loop
        rows.append({"case": f"wrench alone: {name}", "time of a step, ns": f"{spent:.0f}"})
    for row in rows:
        print(row)
    if chosen.keep:
        timed = {"rounds": chosen.rounds, "seconds": float(chosen.seconds), "keep": chosen.keep}
        keep_timed("student_effects.py", chosen.keep, rows, chosen.commit, 1, **timed)


if __name__ == "__main__":
    main()
