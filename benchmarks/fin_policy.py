"""Arrivals of a policy that steers the REMUS 100 with fins, and of the hand-written pilot of fins.

Both fly the same waypoint courses without exploration: in the project's kernels and in MuJoCo, with the time
limit of the training and with twice as much.

    hydro rl train datasets/vehicles/remus100_fins.toml --task waypoints --recipe sac ... -o fins
    python -m benchmarks.fin_policy fins --keep COMMIT
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import polars as pl

from benchmarks.kept_tables import Row, keep, markdown, origin
from hydro.io import vehicle as vehicles
from hydro.rl.environment.helmsman import fin_pilot
from hydro.rl.tasks.waypoints import WaypointCourse
from hydro.rl.training.build import Builder, Simulator
from hydro.rl.training.evaluate import fly, summary
from hydro.rl.training.pilots import Actor
from hydro.rl.training.runs import Folder
from hydro.rl.training.trials import Trial
from hydro.rl.world.config import Settings

SEED = 1_000_000
"""Seed of the courses and of the sensors' noise, as in `hydro rl eval`."""
SIMULATORS: dict[Simulator, str] = {"kernels": "kernels", "student": "MuJoCo"}
TIMES = (1.0, 2.0)
"""Time limits in multiples of that of the training."""


def trial(times: float) -> Trial:
    """Return the test setting with a multiple of the training's time limit."""

    def longer(settings: Settings) -> Settings:
        course = settings.waypoints
        return replace(settings, waypoints=replace(course, pace=course.pace / times))

    return Trial(f"{times:g} times the time", longer)


def flown(builder: Builder, actor: Actor, simulator: Simulator, times: float, episodes: int) -> Row:
    """Return the time limit and the outcome of one actor in one simulator."""
    fleet = builder(episodes, SEED, simulator, trial(times))
    fleet.set_level(WaypointCourse.name)
    found = summary(fly(actor, fleet))
    low, high = 100.0 * found["success_low"], 100.0 * found["success_high"]
    limit = fleet.task.steps(fleet.settings) * fleet.settings.period
    goal = found["time_to_goal"]
    return {
        "time limit": f"{limit:.0f} s",
        "arrived": f"{100.0 * found['success']:.1f} % ({low:.1f} to {high:.1f})",
        "hit a wall": f"{100.0 * found['collision']:.1f} %",
        "median time": "" if goal is None else f"{goal:.0f} s",
        "from the line": f"{found['tracking_error']:.1f} m",
    }


def rows(run: Path, episodes: int, simulators: list[Simulator]) -> list[Row]:
    """Return a row for each simulator, time limit and actor."""
    folder = Folder(run)
    policy, _ = folder.policy()
    builder = Builder(folder.config(), vehicles.parse(folder.run().provenance.vehicle or ""))
    actors: dict[str, Actor] = {"policy": policy, "pilot": fin_pilot}
    return [
        {"simulator": SIMULATORS[simulator], "flown by": name}
        | flown(builder, actor, simulator, times, episodes)
        for simulator in simulators
        for times in TIMES
        for name, actor in actors.items()
    ]


def main(arguments: list[str] | None = None) -> None:
    """Fly the courses, print the table, and keep it with `--keep`."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of the training")
    parser.add_argument("--episodes", type=int, default=200, help="courses of each row")
    parser.add_argument("--in", dest="simulators", nargs="+", choices=list(SIMULATORS))
    parser.add_argument("--keep", metavar="COMMIT", help="keep the table as measured with this commit")
    given = parser.parse_args(arguments)
    found = rows(given.run, given.episodes, given.simulators or list(SIMULATORS))
    print(markdown(found))
    if given.keep:
        command = f"python -m benchmarks.fin_policy fins --episodes {given.episodes}"
        where = origin(pl.DataFrame({"seed": [SEED]}), command, given.keep)
        trained = Folder(given.run).config().seed
        where |= {"seeds": f"training {trained}; courses of {SEED}"}
        keep("fin_policy", [row | where for row in found])


if __name__ == "__main__":
    main()
