"""The tasks by name, and the stages of the curriculum that are made of them (paper III-D)."""

from __future__ import annotations

from difflib import get_close_matches

from hydro.core.errors import UsageError
from hydro.rl.tasks.docking import Docking
from hydro.rl.tasks.forest import Forest
from hydro.rl.tasks.point_to_point import PointToPoint
from hydro.rl.tasks.row import PillarRow
from hydro.rl.tasks.slalom import Slalom
from hydro.rl.tasks.station_keeping import StationKeeping
from hydro.rl.tasks.task import Task
from hydro.rl.tasks.trajectory import Circle, Helix, Lemniscate

TASKS: dict[str, Task] = {
    task.name: task
    for task in (
        PointToPoint(), Slalom(), Forest(), StationKeeping(), Circle(), Helix(), Lemniscate(), Docking(),
        PillarRow(),
    )
}  # fmt: skip
"""All of them; `hydro/rl/__init__.py` has an environment of each."""

STAGES = (PointToPoint.name, Slalom.name, Forest.name)
"""Those of the curriculum, in order."""


def task_of(name: str) -> Task:
    """A task by its name; hyphens are as good as underscores.

    Raises:
        UsageError: There is none.
    """
    known = name.replace("-", "_")
    if known not in TASKS:
        meant = get_close_matches(known, TASKS) or list(TASKS)
        raise UsageError(f"there is no task {name!r}: choose one of {', '.join(meant)}")
    return TASKS[known]
