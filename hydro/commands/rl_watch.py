"""Command `rl watch`: pictures and films of policies and of the scripted pilot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hydro.commands.places import FILE
from hydro.commands.recordings import MaxExpanded
from hydro.commands.rl_flights import Flown, In, Level, Stage, TaskName, Truth, asked_task, flight_of
from hydro.commands.shell import progress, seed_option
from hydro.core.errors import UsageError

if TYPE_CHECKING:
    from hydro.rl.tasks.task import Task
    from hydro.rl.training.build import Builder, Simulator
    from hydro.rl.training.evaluate import Flight
    from hydro.rl.training.policy import Policy

ARRIVED = "success"
"""Outcome of a flight that has reached its goal."""


def watch(
    run: Flown,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="A .png or an .mp4."), FILE],
    simulator: In = "student",
    seed: Annotated[int, seed_option("Seed of the task.")] = 0,
    task: TaskName = None,
    stage: Stage = None,
    level: Level = None,
    truth: Truth = None,
    beside: Annotated[
        Path | None, typer.Option(metavar="RUN", help="Film another run in the same tasks, on the right.")
    ] = None,
    seconds: Annotated[
        float, typer.Option(metavar="S", min=0.0, help="Film further tasks, up to S seconds in all.")
    ] = 0.0,
    max_expanded: MaxExpanded = None,
) -> None:
    r"""Draw or film one run of a policy.

    With a vehicle file in the place of RUN the scripted pilot is shown, with a map. With --truth the policy
    steers another vehicle than the one that it was trained in.

    A .png shows the path in its tank, from above and from the side. An .mp4 is rendered by MuJoCo
    off-screen, and needs the extra `video` and, on a machine without a display, MUJOCO_GL=egl or osmesa.

    Details:

    With --seconds a film shows the tasks of the seeds N, N + 1, ... one after another, each to its end. The
    first is shown even if it takes longer. A run that ends before the other one waits. A film of two
    policies in a changed vehicle, in the reference simulator:

        hydro rl watch before --beside after --truth true.toml --in teacher \
          --seconds 60 -o film.mp4
    """
    if output.suffix not in (".png", ".mp4"):
        raise UsageError(f"{output}: name a .png for a picture or an .mp4 for a film")
    shown = _Shown.of(run, asked_task(run, task, stage), level, truth, simulator)
    if output.suffix == ".png":
        if beside is not None or seconds:
            raise UsageError(f"{output}: a picture shows one flight; with --beside or --seconds name an .mp4")
        ending = _draw(shown, seed, output)
    else:
        shows = [shown]
        if beside is not None:
            shows.append(_Shown.of(beside, shown.task.name, shown.level, truth, simulator))
        ending = _film(shows, seed, seconds, output)
    typer.echo(f"{output}: {ending}", err=True)


@dataclass(frozen=True)
class _Shown:
    """Actor and task of a picture or film: the policy of a training, or the hand-written pilot.

    Attributes:
        run: Folder of the training, or a vehicle file.
        policy: The policy; None for the hand-written pilot.
        builder: Builder of fleets.
        task: The task.
        level: Level of the task.
        simulator: Simulator of the flights.
    """

    run: Path
    policy: Policy | None
    builder: Builder
    task: Task
    level: int
    simulator: Simulator

    @classmethod
    def of(
        cls, run: Path, task: str | None, level: int | None, truth: Path | None, simulator: Simulator
    ) -> _Shown:
        """Return what is shown, actor and task, for a training or a vehicle file.

        The arguments are those of `rl_flights.flight_of`.
        """
        policy, _, builder, chosen, at = flight_of(run, task, level, truth)
        return cls(run, policy, builder, chosen, at, simulator)

    def flight(self, seed: int) -> Flight:
        """Return the recorded flight in the task that a seed draws.

        Args:
            seed: Seed of the task.
        """
        from hydro.rl.training.evaluate import trace
        from hydro.rl.training.pilots import WithMap
        from hydro.rl.training.trials import NOMINAL, TRIALS

        fleet = self.builder(1, seed, self.simulator, TRIALS[NOMINAL])
        fleet.set_level(self.task, self.level)
        return trace(WithMap(fleet) if self.policy is None else self.policy, fleet)


def _ending(flight: Flight) -> str:
    """Return the outcome of a flight with its time, such as "success after 9.5 s"."""
    return f"{flight.outcome} after {flight.t[-1]:.1f} s"


def _draw(shown: _Shown, seed: int, output: Path) -> str:
    """Draw the path of a flight, and return its ending."""
    from hydro.report.training import Tank, draw_flight, save

    flight, config = shown.flight(seed), shown.builder.config
    world, ending = config.settings.world, _ending(flight)
    size = world.length, world.width, world.depth
    who = "a pilot by hand" if shown.policy is None else f"{config.condition}, seed {config.seed}"
    tank = Tank(size, flight.pillars, world.pillar_radius, flight.goal, config.settings.task.radius)
    title = f"{shown.task.name}, {who}, in the {shown.simulator}: {ending}"
    save(draw_flight(flight.pose[:, :3], flight.way, tank, title), output)
    return ending


def _film(shows: Sequence[_Shown], seed: int, seconds: float, output: Path) -> str:
    """Film one or more runs side by side; return the outcome of one flight, or the numbers of arrivals.

    Raises:
        UsageError: Tank or control period of two runs differ.
    """
    from hydro.sim.film import Flown, Panel, film

    first = shows[0].builder.config.settings
    world, period = first.world, first.period
    for other in shows[1:]:
        settings = other.builder.config.settings
        if (settings.world, settings.period) != (world, period):
            raise UsageError(f"{other.run}: its tank or control period is not that of {shows[0].run}")
    with progress(f"film {', '.join(show.run.name for show in shows)}"):
        flights = _flights(shows, seed, seconds)
        panels = [
            Panel(
                show.builder.vehicle,
                [Flown(one.pose, one.targets, one.pillars, period, _ending(one)) for one in own],
                show.run.name,
            )
            for show, own in zip(shows, flights, strict=True)
        ]
        film(panels, (world.length, world.width, world.depth), radius=world.pillar_radius, output=output)
    if len(shows) == len(flights[0]) == 1:
        return _ending(flights[0][0])
    arrived = [sum(one.outcome == ARRIVED for one in own) for own in flights]
    counts = zip(shows, arrived, strict=True)
    return ", ".join(f"{show.run.name} arrived in {n} of {len(flights[0])} tasks" for show, n in counts)


def _flights(shows: Sequence[_Shown], seed: int, seconds: float) -> list[tuple[Flight, ...]]:
    """Return for every run the flights in the tasks of successive seeds, as many as fit into the film.

    Args:
        shows: The runs.
        seed: First seed.
        seconds: Length of the film [s]; the first flights are included even if they take longer.
    """
    from hydro.sim.film import HOLD

    rounds, length = list[list["Flight"]](), 0.0
    while length <= seconds:
        together = [show.flight(seed) for show in shows]
        length += max(flight.t[-1] for flight in together) + HOLD
        if not rounds or length <= seconds:
            rounds.append(together)
        seed += 1
    return list(zip(*rounds, strict=True))
