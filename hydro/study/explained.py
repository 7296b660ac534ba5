"""Files about a whole study of `hydro explain`: replays, unexplained forces, growth, sessions and bands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from hydro.core.errors import DataError

if TYPE_CHECKING:
    from hydro.core.diagnosis.log_faults import Preprocessed
    from hydro.core.explanation.ladder import Step
    from hydro.core.vehicle.description import Vehicle
    from hydro.io.study import Study


def save_recorded(study: Study, vehicles: Mapping[int, Vehicle], log: Preprocessed) -> None:
    """Write the tables of a study that replay the recordings or show unexplained forces, into its folder.

    The files are `replay`, the recorded and predicted motions; `leftover`, unexplained forces, and `growth`,
    powers of velocity by which the force grows, if there are enough samples; and `sessions`, the list of
    sessions.

    Args:
        study: The study.
        vehicles: Vehicles of the steps that are drawn, by their numbers; the last is the one to use.
        log: Recording that was fitted.
    """
    import polars as pl

    from hydro.core.evaluation.growth import growth
    from hydro.core.evaluation.leftover import leftover
    from hydro.core.evaluation.rolling_prediction import restarted
    from hydro.core.explanation.ladder import DATASETS
    from hydro.core.recording.segments import sessions
    from hydro.io.study import NO_FORCES

    given = [one.frame for one in (study.measured, study.holdout) if one is not None]
    study.save("replay", restarted({f"step-{k}": one for k, one in vehicles.items()}, given[-1]))
    why = ""
    try:
        study.save("leftover", leftover(dict(vehicles), log.raw, log.observed))
        grown = growth(list(vehicles.values())[-1], log.raw, log.observed)
        if not grown.is_empty():
            study.save("growth", grown)
    except DataError as error:  # too few samples; other errors in a recording have ended the study before
        why = str(error)
    listed = [
        sessions(frame).with_columns(dataset=pl.lit(name))
        for name, frame in zip(DATASETS, given, strict=False)
    ]
    study.save("sessions", pl.concat(listed), **({NO_FORCES: why} if why else {}))


def save_bands(study: Study, step: Step) -> str:
    """Write the 95 % intervals (bands) of a step's predictions to the study's folder.

    They are written only if values were fitted in the step.

    Args:
        study: The study.
        step: Step of the study whose vehicle predicts.

    Returns:
        The reason why there are no bands; empty if they were written or no value was fitted.
    """
    from hydro.core.evaluation.rolling_prediction import FEW_DRAWS, restarted_bands

    if step.estimates is None:
        return ""
    shown = study.holdout or study.measured
    try:
        frame = restarted_bands(step.vehicle, step.estimates, shown.frame)
    except DataError as error:
        return str(error)
    study.save("bands", frame, draws=FEW_DRAWS, step=step.number)
    return ""
