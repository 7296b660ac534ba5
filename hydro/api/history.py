"""Result of `hydro.track`, and the function."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hydro.api.order import Progress
from hydro.api.result import Result
from hydro.api.threads import one_thread

if TYPE_CHECKING:
    import numpy as np
    import polars as pl
    from numpy.typing import NDArray

    from hydro.core.vehicle.description import Vehicle
    from hydro.report.result_axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class History(Result):
    """Parameters of a vehicle over its dives, and their changes, as `hydro.track` finds them.

        history = hydro.track(vehicle, {"monday": first, "tuesday": second, "friday": third}, baseline=2)
        print(history.headline)

    Attributes:
        table: History table, one row per dive and parameter.
        changes: One row per change: parameter, kind, dives, levels before and after, standard error of the
            difference, and a sentence.
        answer: All changes in sentences, or that there are none; the same as `headline`.
        undetermined: Names of the parameters that the dives do not determine.
    """

    changes: pl.DataFrame
    answer: str
    undetermined: tuple[str, ...] = ()

    @property
    def headline(self) -> str:
        """All changes in sentences, or that there are none."""
        return self.answer

    def summary(self) -> pl.DataFrame:
        """Return a new table of the changes, one row each: `changes` without its sentences."""
        return self.changes.drop("sentence")

    def plot(self, axes: Axes | Sequence[Axes] | None = None) -> NDArray[np.object_]:
        """Draw each parameter over the dives, with 95 % intervals and the fitted level.

        Args:
            axes: Matplotlib axes to draw into, one per parameter; by default a new figure's.

        Returns:
            The axes into which it drew, one for each of n parameters, (n,); `axes[0].figure` is the figure.
        """
        from hydro.report.result_axes import time_lines

        return time_lines(self.table, axes)

    def to_json(self) -> str:
        """Return the result as JSON text, with the keys of `hydro track --json` except `new`."""
        from hydro.report.json_text import json_text

        return json_text(headline=self.headline, changes=self.changes, history=self.table)


@one_thread
def track(
    vehicle: Vehicle,
    dives: Mapping[str, pl.DataFrame],
    *,
    baseline: int = 4,
    progress: Progress | None = None,
) -> History:
    """Find out whether a vehicle has changed over its dives, and when.

    Args:
        vehicle: vehicle, from `hydro.vehicle`.
        dives: raw table of each dive, by its name, the oldest first.
        baseline: number of first dives of the unchanged vehicle, at least 2.
        progress: called as `progress(words, share)`: the present work, and the share that is done, 0 to 1.

    Returns:
        The history: `table` with the thrust of every thruster, the drag on each axis and the net buoyancy in
        each dive, relative to the baseline, and `changes`.

    Raises:
        hydro.core.errors.DataError: a dive does not fit the vehicle, or is too short.
        hydro.core.errors.UsageError: there are fewer dives than the baseline needs.
    """
    from hydro.core.errors import UsageError
    from hydro.core.history.baseline import LEAST_DIVES, learn_baseline
    from hydro.core.history.estimate import estimate
    from hydro.core.history.history import history
    from hydro.core.progress import silent
    from hydro.io.table import conform

    if not LEAST_DIVES <= baseline <= len(dives):
        raise UsageError(
            f"{len(dives)} dives with a baseline of {baseline}: give at least {LEAST_DIVES} of each"
        )
    tell, names = progress or silent, list(dives)
    tell("learning the baseline", 0.0)
    learnt = learn_baseline(vehicle, {name: dives[name] for name in names[:baseline]})
    found = {}
    for number, (name, raw) in enumerate(dives.items()):
        tell(name, (number + 1) / (len(dives) + 1))
        found[name] = estimate(learnt, name, raw)
    whole = history(learnt.parameters, found, names[:baseline])
    dropped = tuple(one.name for one in whole.undetermined)
    return History(conform("history", whole.table()), whole.changes_table(), whole.headline, dropped)
