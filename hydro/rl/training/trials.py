"""The settings that policies are tested in, and a pilot by hand beside them: as trained, and worse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from hydro.core.errors import UsageError
from hydro.rl.tasks.task import Task
from hydro.rl.world.config import Randomisation, Settings

NOMINAL = "nominal"
EVERY = "all"


@dataclass(frozen=True)
class Trial:
    """A setting.

    Attributes:
        words: What is other in it.
        change: The settings with that in them.
        planless: Whether no planned way is shown.
        posterior: Whether a covariance of the vehicle file's numbers is needed.
    """

    words: str
    change: Callable[[Settings], Settings] = lambda settings: settings
    planless: bool = False
    posterior: bool = False

    def of(self, settings: Settings) -> Settings:
        """The settings of the trial: nothing is drawn but what it says."""
        return self.change(replace(settings, randomise=Randomisation()))

    def suits(self, task: Task, *, estimates: bool) -> bool:
        """Whether a task can be flown in it; `estimates`: there is a covariance."""
        return (task.guided or not self.planless) and (estimates or not self.posterior)


def _drawn(**what: float | bool) -> Callable[[Settings], Settings]:
    """Settings with draws of a kind."""
    randomise = Randomisation(**what)  # type: ignore[arg-type]
    return lambda settings: replace(settings, randomise=randomise)


def _hurried(settings: Settings) -> Settings:
    """Settings with half the time."""
    return replace(settings, task=replace(settings.task, steps=max(settings.task.steps // 2, 1)))


TRIALS = {
    NOMINAL: Trial("as the vehicle file says"),
    "no_plan": Trial("the goal is shown, and no planned way", planless=True),
    "current": Trial("a current of 0.3 m/s, in any direction", _drawn(current=0.3, full=True)),
    "load": Trial("10 % of the mass more, anywhere on board", _drawn(load=0.1, full=True)),
    "dead_thruster": Trial("one thruster dead", _drawn(thruster=1.0, full=True)),
    "posterior": Trial(
        "numbers drawn from the covariance beside the file", _drawn(posterior=True), posterior=True
    ),
    "half_time": Trial("half the time", _hurried),
}


def trials_of(names: list[str], task: Task, *, estimates: bool) -> dict[str, Trial]:
    """Trials by their names, all that suit a task for `all`.

    Raises:
        UsageError: There is no such trial, or it does not suit the task.
    """
    if EVERY in names:
        return {name: one for name, one in TRIALS.items() if one.suits(task, estimates=estimates)}
    for name in names:
        if name not in TRIALS:
            raise UsageError(f"there is no setting {name!r}: choose one of {', '.join(TRIALS)}, or {EVERY}")
        if not TRIALS[name].suits(task, estimates=estimates):
            lacks = (
                "a covariance beside the vehicle file" if TRIALS[name].posterior else "a plan to leave out"
            )
            raise UsageError(f"{name}: {task.name} is without {lacks}")
    return {name: TRIALS[name] for name in names}
