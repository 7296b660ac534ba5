"""Registry of tasks by name, and the stages of the curriculum (Wu et al., section III-D)."""

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
from hydro.rl.tasks.waypoints import WaypointCourse

TASKS: dict[str, Task] = {
    task.name: task
    for task in (
        PointToPoint(), Slalom(), Forest(), StationKeeping(), Circle(), Helix(), Lemniscate(), Docking(),
        PillarRow(), WaypointCourse(),
    )
}  # fmt: skip
"""All tasks by name; `hydro/rl/__init__.py` registers an environment for each."""

STAGES = (PointToPoint.name, Slalom.name, Forest.name)
"""Names of the curriculum's tasks, in order."""


def task_of(name: str) -> Task:
    """Return a task by its name; hyphens may replace underscores.

    Raises:
        UsageError: The name is unknown.
    """
    known = name.replace("-", "_")
    if known not in TASKS:
        meant = get_close_matches(known, TASKS) or list(TASKS)
        raise UsageError(f"there is no task {name!r}: choose one of {', '.join(meant)}")
    return TASKS[known]
