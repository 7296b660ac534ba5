"""Accuracy and speed of integrators and steps: replay error against simulated seconds per second.

A vehicle with all effects of its file moves for 60 s, in twelve segments of 5 s with their own initial states
and commands.  The reference is `simulation.simulate` with a step of 0.25 ms; MuJoCo repeats the segments with
every integrator and step.  Commands are held for 20 ms, as in a log of 50 Hz.  The error of a setting is the
root mean square difference in velocity (u, v, w) over all segments.  Speed is that of one thread, by its
processor time, which equals wall time on an idle machine; a median over rounds.

    python benchmarks/accuracy.py -o accuracy.parquet --plot docs/images/accuracy.png
    # Draw the kept table again, without a measurement.
    python benchmarks/accuracy.py --kept --plot docs/images/accuracy.png
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from hydro.core.columns import Array
from hydro.core.effects import assemble
from hydro.core.simulation.sensor_noise import PROFILES
from hydro.core.simulation.simulate import steps_of_row, trajectory
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files
from hydro.sim.bridge.mjcf import Integrator
from hydro.sim.student import Physics, Student

ROOT = Path(__file__).resolve().parents[1]
VEHICLES = ROOT / "datasets" / "vehicles"
KEPT = ROOT / "benchmarks" / "results" / "integrators.csv"
INTEGRATORS: tuple[Integrator, ...] = ("euler", "implicitfast", "rk4")
STEPS = (0.0005, 0.001, 0.002, 0.004, 0.005, 0.01, 0.02)
SEGMENTS, SECONDS, HELD = 12, 5.0, 0.02
REFERENCE = 4_000.0  # Hz
COLOURS = {"euler": "#D55E00", "implicitfast": "#0072B2", "rk4": "#009E73"}
LABELS = {"euler": "Euler", "implicitfast": "implicitfast", "rk4": "RK4"}


def flights(thrusters: int) -> tuple[Array, Array, Array]:
    """Return initial states and commands of S segments: waves, with a jump in the command of every thruster.

    Args:
        thrusters: Number of thrusters n.

    Returns:
        eta (S, 6), NED [m, rad], nu (S, 6), FRD [m/s, rad/s], and commands (S, rows, n).
    """
    rng = np.random.default_rng(0)
    t = np.arange(round(SECONDS / HELD))[None, :, None] * HELD
    eta = rng.uniform(-1, 1, (SEGMENTS, 6)) * [5.0, 5.0, 2.0, 0.3, 0.3, np.pi] + [0, 0, 20, 0, 0, 0]
    nu = rng.uniform(-1, 1, (SEGMENTS, 6)) * [0.8, 0.4, 0.3, 0.2, 0.2, 0.4]
    shape = (SEGMENTS, 1, thrusters)
    waves = 0.4 * np.sin(2 * np.pi * rng.uniform(0.1, 0.6, shape) * t + rng.uniform(0, 6, shape))
    jumps = 0.4 * rng.normal(size=shape) * (t > rng.uniform(0.5, 4.0, shape))
    return eta, nu, waves + jumps


def reference(vehicle: Vehicle, eta: Array, nu: Array, commands: Array) -> Array:
    """Return the motion (S, rows, 12) at the end of every row, simulated with a step of 0.25 ms."""
    program, rows = assemble(vehicle), commands.shape[1]
    t = np.arange(rows + 1) * HELD
    held = np.concatenate([commands, commands[:, -1:]], axis=1)
    return np.stack(
        [
            trajectory(program, held[k], t, eta=eta[k], nu=nu[k], steps=steps_of_row(HELD, REFERENCE))[1:]
            for k in range(SEGMENTS)
        ]
    )


def measure(vehicle: Vehicle, rounds: int, steps: tuple[float, ...]) -> pl.DataFrame:
    """Return error and speed of every integrator and step, one row each.

    Args:
        vehicle: Vehicle file.
        rounds: Number of rounds, of which the median speed counts.
        steps: Integration steps [s].
    """
    eta, nu, commands = flights(len(vehicle.thruster))
    truth = reference(vehicle, eta, nu, commands)
    settings = [(integrator, step) for integrator in INTEGRATORS for step in steps]
    students = [
        Student(vehicle, count=SEGMENTS, physics=Physics(timestep=step, integrator=integrator))
        for integrator, step in settings
    ]
    seconds = np.empty((rounds, len(settings)))
    errors = np.empty((len(settings), 3))
    for turn in range(rounds):
        for k in range(len(settings)):
            k = (turn + k) % len(settings)
            student = students[k]
            student.start(eta, nu)
            begin = time.process_time()
            motion = student.fly(commands, round(HELD / settings[k][1]))
            seconds[turn, k] = time.process_time() - begin
            apart = motion - truth
            errors[k] = (
                np.sqrt(np.mean(apart[..., 6:9] ** 2)),
                np.sqrt(np.mean(apart[..., 9:] ** 2)),
                np.linalg.norm(apart[:, -1, :3], axis=1).max(),
            )
    rows: list[dict[str, Any]] = [
        {
            "vehicle": vehicle.name,
            "integrator": integrator,
            "step": step,
            "velocity_error": errors[k, 0],
            "rate_error": errors[k, 1],
            "position_error": errors[k, 2],
            "speed": SEGMENTS * SECONDS / float(np.median(seconds[:, k])),
        }
        for k, (integrator, step) in enumerate(settings)
    ]
    return pl.DataFrame(rows)


def kept(vehicle: str) -> pl.DataFrame:
    """Return the kept table of a vehicle, one row per setting, as far as a plot needs it."""
    rows = pl.read_csv(KEPT)
    blocks = [
        rows.select(
            pl.lit(vehicle).alias("vehicle"),
            pl.lit(integrator).alias("integrator"),
            step=pl.col("step, ms") * 1e-3,
            velocity_error=f"{LABELS[integrator]}: velocity, m/s",
            speed=pl.col("times real time" + " " * number).cast(pl.Float64),
        )
        for number, integrator in enumerate(INTEGRATORS)
    ]
    return pl.concat(blocks)


def show(table: pl.DataFrame) -> None:
    """Print the table that is drawn."""
    print(
        "| integrator | step, ms | velocity, rms m/s | rates, rms rad/s | position after 5 s, m | "
        "times real time |"
    )
    print("|---|---:|---:|---:|---:|---:|")
    for r in table.to_dicts():
        print(
            f"| {LABELS[r['integrator']]} | {1e3 * r['step']:g} | {r['velocity_error']:.1e} | "
            f"{r['rate_error']:.1e} | {r['position_error']:.1e} | {r['speed']:.0f} |"
        )


def plot(table: pl.DataFrame, path: Path) -> None:
    """Draw the table: one curve per integrator, one point per step."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 4.8), dpi=150, layout="constrained")
    axes = figure.add_subplot()
    for integrator, colour in COLOURS.items():
        part = table.filter(pl.col("integrator") == integrator)
        axes.loglog(part["speed"], part["velocity_error"], "o-", color=colour, label=LABELS[integrator])
        for step, speed, error in part.select("step", "speed", "velocity_error").rows():
            below = integrator != "implicitfast"
            axes.annotate(
                f"{1e3 * step:g}",
                (speed, error),
                textcoords="offset points",
                xytext=(4, -13) if below else (-10, 3),
                ha="center",
                fontsize=8,
                color=colour,
            )
    noise = PROFILES["ordinary"].velocity
    axes.axhline(noise, color="#888888", linewidth=0.8, linestyle="--")
    axes.annotate(
        f"noise of an ordinary DVL, {noise:g} m/s",
        (0.01, noise),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        xytext=(0, 4),
        fontsize=8,
        color="#555555",
    )
    axes.set_xlabel("simulated seconds per second of one core")
    axes.set_ylabel("velocity error, rms [m/s]")
    axes.set_title(
        f"{table['vehicle'][0]} with all effects; numbers are steps in ms", loc="left", fontsize=10.5
    )
    axes.grid(color="#E6E6E6", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_ylim(bottom=0.1 * float(table["velocity_error"].to_numpy().min()), top=10 * noise)
    axes.legend(frameon=False, loc="lower right")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Software": ""})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicle", default="auv151", help="preset")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--quick", action="store_true", help="two steps and one round")
    parser.add_argument("--kept", action="store_true", help="draw the kept table, without a measurement")
    parser.add_argument("--plot", type=Path, help="where to draw it, as .png or .svg")
    parser.add_argument("-o", "--out", type=Path, help="write the table as .parquet")
    chosen = parser.parse_args()
    if chosen.kept:
        plot(kept(chosen.vehicle), chosen.plot or ROOT / "docs" / "images" / "accuracy.png")
        return
    vehicle = files.read(VEHICLES / f"{chosen.vehicle}.toml")[0]
    table = measure(vehicle, 1, (0.005, 0.01)) if chosen.quick else measure(vehicle, chosen.rounds, STEPS)
    show(table)
    if chosen.out:
        table.write_parquet(chosen.out)
    if chosen.plot:
        plot(table, chosen.plot)


if __name__ == "__main__":
    main()
