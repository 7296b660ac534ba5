"""Test settings for policies and pilots: nominal, and with harder conditions than in training."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from hydro.core.errors import UsageError
from hydro.rl.tasks.task import Task
from hydro.rl.world.config import Randomisation, Settings

NOMINAL = "nominal"  # setting without changes
EVERY = "all"  # selects all settings that suit a task


@dataclass(frozen=True)
class Trial:
    """Test setting: the conditions in which a policy or pilot is evaluated.

    Attributes:
        words: Description of its difference from the nominal setting.
        change: Function that applies the difference to the settings.
        planless: Whether the planned path is hidden.
        posterior: Whether the test requires a covariance of the vehicle file's parameters.
    """

    words: str
    change: Callable[[Settings], Settings] = lambda settings: settings
    planless: bool = False
    posterior: bool = False

    def of(self, settings: Settings) -> Settings:
        """Return a copy of `settings`, changed for this test, without random differences of training."""
        return self.change(replace(settings, randomise=Randomisation()))

    def suits(self, task: Task, *, estimates: bool) -> bool:
        """Return whether a task can be tested in this setting.

        Args:
            task: The task.
            estimates: Whether a covariance of the vehicle file's parameters is available.
        """
        return (task.guided or not self.planless) and (estimates or not self.posterior)


def _randomised(**what: float | bool) -> Callable[[Settings], Settings]:
    """Return a function that replaces the random differences of settings by those given by name."""
    randomise = Randomisation(**what)  # type: ignore[arg-type]
    return lambda settings: replace(settings, randomise=randomise)


def _half_time(settings: Settings) -> Settings:
    """Return settings with half the time limit; that of waypoints follows from their pace."""
    task = replace(settings.task, steps=max(settings.task.steps // 2, 1))
    return replace(
        settings, task=task, waypoints=replace(settings.waypoints, pace=2.0 * settings.waypoints.pace)
    )


TRIALS = {
    NOMINAL: Trial("as the vehicle file says"),
    "no_plan": Trial("the goal is shown, without a planned path", planless=True),
    "current": Trial("a current of 0.3 m/s, in any direction", _randomised(current=0.3, full=True)),
    "load": Trial("a load of 10 % of the mass, anywhere on board", _randomised(load=0.1, full=True)),
    "dead_thruster": Trial("one thruster dead", _randomised(thruster=1.0, full=True)),
    "posterior": Trial(
        "parameters drawn from the covariance of the file",
        _randomised(posterior=True),
        posterior=True,
    ),
    "half_time": Trial("half the time", _half_time),
}


def trials_of(names: list[str], task: Task, *, estimates: bool) -> dict[str, Trial]:
    """Return test settings by their names; the name `all` stands for every setting that suits the task.

    Args:
        names: Names of test settings, or `all`.
        task: Task to test.
        estimates: Whether a covariance of the vehicle file's parameters is available.

    Raises:
        UsageError: A name is unknown, or its setting does not suit the task.
    """
    if EVERY in names:
        return {name: one for name, one in TRIALS.items() if one.suits(task, estimates=estimates)}
    for name in names:
        if name not in TRIALS:
            raise UsageError(f"there is no setting {name!r}: choose one of {', '.join(TRIALS)}, or {EVERY}")
        if not TRIALS[name].suits(task, estimates=estimates):
            if TRIALS[name].posterior:
                raise UsageError(f"{name} needs a covariance of the vehicle file")
            raise UsageError(f"{name} needs a planned path, and {task.name} has none")
    return {name: TRIALS[name] for name in names}
