"""Simulate a vehicle, fit it, compare it with a recording, and find missing effects."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from hydro.api.comparison import Comparison
from hydro.api.diagnosis import Diagnosis
from hydro.api.fitted import Fit
from hydro.api.order import Progress, vehicle_first
from hydro.api.result import frame_of
from hydro.api.study import Step, Study
from hydro.api.threads import one_thread

if TYPE_CHECKING:
    import polars as pl

    from hydro.core.explanation.ladder import Step as Rung
    from hydro.core.residual.hull import Hull
    from hydro.core.vehicle.description import Vehicle
    from hydro.io.model import Model


@vehicle_first
def simulate(vehicle: Vehicle, commands: pl.DataFrame, *, sea: int | None = None) -> pl.DataFrame:
    """Simulate the motion of a vehicle under given thruster commands, with every effect of its file.

    Args:
        vehicle: vehicle, from `hydro.vehicle`.
        commands: table with `session`, `t` [s] and `cmd_1 ... cmd_n` in [-1, 1], one column per thruster; a
            row acts until the next. Every session starts at rest at the origin. With a raw table instead,
            the first row of each session is its initial state.
        sea: seed of random waves, for a file with the effect `ocean_waves`; sessions get different waves.
            None for a calm sea, as in every prediction.

    Returns:
        Raw table of the simulated motion, without sensor noise: pose (x y z [m], phi theta psi [rad]) in the
        world (NED), velocities (u v w [m/s], p q r [rad/s]) in body axes (FRD), and commands.

    Raises:
        hydro.core.errors.DataError: the commands do not fit the vehicle, or the motion diverges.
    """
    from hydro.core.simulation.simulate import simulate as move
    from hydro.io.table import conform

    return conform("raw", move(vehicle, commands, sea=sea))


@vehicle_first
@one_thread
def fit(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    effects: Sequence[str | Mapping[str, Any]],
    *,
    method: Literal["output", "equation"] = "output",
    noise: Sequence[float] | None = None,
    shots: int = 1000,
    progress: Progress | None = None,
) -> Fit:
    """Estimate the parameters of named effects from a recording, with standard errors.

    Args:
        vehicle: vehicle, from `hydro.vehicle`; effects of its file start from their values, others from zero.
        raw: recording as a raw table, from `hydro.import_log` or `hydro.read`.
        effects: effects to fit, by their names in the catalogue (`hydro effects` lists them), such as
            `linear_damping`; or `linear_damping.matrix` for another form of it. An effect may also be a
            table with initial values, such as `{"name": "net_buoyancy", "dB": 3.0}`.
        method: `output` minimises the error of predictions over shots of two seconds. `equation` minimises
            the error of the equations of motion along the smoothed motion, which is quicker but biased by
            noise.
        noise: twelve standard deviations: of position [m] (3), attitude [rad] (3), velocity [m/s] (3) and
            rates [rad/s] (3); by default estimated from the recording.
        shots: maximum number of shots (`output`) or windows (`equation`); a longer recording is sampled
            evenly.
        progress: called as `progress(words, share)`: the present work, and the share that is done, 0 to 1.

    Returns:
        The fit: `vehicle` with the estimates, `table` with one row per parameter (value, standard error,
        unit, whether the data determine it), `covariance`, `chi2` and `warnings`. `hydro.add` writes the
        values and their standard errors into a vehicle.

    Raises:
        hydro.core.errors.DataError: there is no such effect, the recording contradicts the vehicle (for
            example by swapped columns), or the predicted motion diverges.
    """
    import numpy as np

    from hydro.core.identification.fit import fit as estimate
    from hydro.core.recording.arrays import recording

    sigma = None if noise is None else np.asarray(noise, dtype=float)
    found = estimate(vehicle, raw, effects, method=method, noise=sigma, most=shots, progress=progress)
    return Fit.of(found, vehicle, recording(vehicle, raw).dt)


@vehicle_first
@one_thread
def compare(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    against: pl.DataFrame | Comparison | None = None,
    before: pl.DataFrame | None = None,
    model: Model | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Measure how well a vehicle predicts a recording, and where its errors are largest.

    Args:
        vehicle: vehicle, from `hydro.vehicle`.
        raw: recording as a raw table, from `hydro.import_log` or `hydro.read`.
        against: earlier comparison of another vehicle file with the same recording; its errors become the
            column `before`.
        before: raw table of the same vehicle before a change. A model of the hull force is fitted to it and
            held fixed; rows of the level `hull` have the errors with this model, before and after.
        model: only with `before`: network of `hydro.train` as the hull-force model, instead of the built-in
            regression.
        progress: called as `progress(words, share)`: the present work, and the share that is done, 0 to 1.

    Returns:
        The comparison: errors of force [N, N m] and of predictions [m, rad, m/s, rad/s] by axis, horizon and
        regime of motion. Each has its noise floor, the error that sensor noise alone causes.

    Raises:
        hydro.core.errors.DataError: the table does not fit the vehicle.
    """
    from hydro.core.diagnosis.log_faults import preprocess
    from hydro.core.evaluation.compare import compare as measure
    from hydro.core.explanation.with_hull import with_hull
    from hydro.io.table import conform

    hull = _hull(vehicle, before, model)
    log = preprocess(vehicle, raw, hull)
    earlier = None if against is None else frame_of(against)
    found = measure(vehicle, log.raw, record=log.observed, against=earlier, progress=progress)
    if hull is not None:
        found = with_hull(found, vehicle, log, hull)
    return Comparison(conform("comparison", found))


@vehicle_first
@one_thread
def diagnose(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    before: pl.DataFrame | None = None,
    model: Model | None = None,
    discover: bool = False,
    correct_thrusters: bool = False,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find the physical effects that a vehicle lacks, or that have changed, with their confidence.

    Args:
        vehicle: vehicle, from `hydro.vehicle`.
        raw: recording as a raw table, from `hydro.import_log` or `hydro.read`.
        before: raw table of the same vehicle before a change; the findings are then changes since.
        model: only with `before`: network of `hydro.train` as the hull-force model, instead of the built-in
            regression.
        discover: search a formula of sparse terms if no effect of the catalogue explains the recording; not
            with `before`.
        correct_thrusters: if the recording contradicts the directions or the order of the thrusters,
            continue with those that it shows; by default the contradiction is then the only finding.
        progress: called as `progress(words, share)`: the present work, and the share that is done, 0 to 1.

    Returns:
        The diagnosis: `headline`, `vehicle` with the confirmed findings, and `table` with one finding per
        row, that with the largest share of the error first, with verdict, values, confidence and advice.

    Raises:
        hydro.core.errors.DataError: a table does not fit the vehicle, or is too short.
        hydro.core.errors.UsageError: `model` without `before`, or `discover` with it.
    """
    from hydro.core.diagnosis.log_faults import preprocess
    from hydro.core.diagnosis.pipeline import diagnose_log
    from hydro.core.discovery.discover import discovered
    from hydro.io.table import conform

    hull = _hull(vehicle, before, model, discover=discover)
    log = preprocess(vehicle, raw, hull)
    log = log.as_audited() if correct_thrusters else log
    beyond = discovered if discover else None
    found = diagnose_log(vehicle, log, hull=hull, beyond=beyond, progress=progress)
    return Diagnosis.of(found, vehicle, conform("diagnosis", found.frame()), changed=hull is not None)


def add(
    vehicle: Vehicle,
    diagnosis: Diagnosis | Fit | pl.DataFrame,
    effects: Sequence[str] | None = None,
    *,
    force: bool = False,
) -> Vehicle:
    """Add the effects of a diagnosis or a fit to a vehicle, with their standard errors.

    Args:
        vehicle: vehicle that was diagnosed or fitted.
        diagnosis: result of `hydro.diagnose` or `hydro.fit`, or a diagnosis table.
        effects: names of the effects to add; by default all that were fitted, or all confirmed ones. An
            unconfirmed effect (confidence below 0.9) is added only by its name.
        force: add findings even if they do not lower the prediction error on held-out data. A plain table
            does not have that error, so its findings are not checked.

    Returns:
        The vehicle with these effects.

    Raises:
        hydro.core.errors.DataError: there is nothing to add, no effect of such a name, or the findings do
            not lower the prediction error.
    """
    from hydro.core.diagnosis.findings import extended, no_better, tables
    from hydro.core.errors import DataError

    if not isinstance(diagnosis, Fit):
        found = tables(frame_of(diagnosis), effects)
        if isinstance(diagnosis, Diagnosis) and not force:
            names = [table["name"] for table in found]
            if why := no_better(diagnosis.table, diagnosis.prediction, names, alone=bool(effects)):
                raise DataError(f"{why}; force=True adds it all the same")
        return extended(vehicle, found)
    fitted = {table["name"]: table for table in diagnosis.tables()}
    wanted = list(effects or fitted)
    if unknown := [name for name in wanted if name not in fitted]:
        raise DataError(f"the fit has no effect {unknown[0]} to add; it has {', '.join(fitted)}")
    return extended(vehicle, [fitted[name] for name in wanted])


@vehicle_first
@one_thread
def explain(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    holdout: pl.DataFrame | None = None,
    before: pl.DataFrame | None = None,
    model: Model | None = None,
    discover: bool = False,
    correct_thrusters: bool = False,
    add: Sequence[str] = (),
    on_step: Callable[[Step], object] | None = None,
    progress: Progress | None = None,
) -> Study:
    """Add missing or changed effects to a vehicle step by step, until nothing more is found.

    Args:
        vehicle: vehicle, from `hydro.vehicle`.
        raw: recording as a raw table, from `hydro.import_log` or `hydro.read`.
        holdout: raw table to which nothing is fitted; the study ends with a step that predicts it worse.
        before: raw table of the same vehicle before a change. A model of the hull force is fitted to it and
            held fixed; the steps then add changes since.
        model: only with `before`: network of `hydro.train` as the hull-force model, instead of the built-in
            regression.
        discover: add a formula of sparse terms if no effect of the catalogue explains the residual; not with
            `before`.
        correct_thrusters: if the recording contradicts the directions or the order of the thrusters,
            continue with those that it shows; by default an error is raised.
        add: findings to add, one in each step, as `hydro explain --add` names them; by default each step adds
            the best one.
        on_step: called with each step as soon as it is done; `print` prints its headline.
        progress: called as `progress(words, share)`: the present work, and the share of the present step
            that is done, 0 to 1.

    Returns:
        The study: `steps`, of which step 0 is the vehicle as given, each with its vehicle, comparison and
        diagnosis; `table` with the errors of all steps; and `vehicle`, that of the step to use.

    Raises:
        hydro.core.errors.DataError: a table does not fit the vehicle, is too short, or contradicts the
            directions or the order of its thrusters.
    """
    from hydro.core.discovery.discover import discovered
    from hydro.core.explanation.explain import ending
    from hydro.core.explanation.explain import explain as steps
    from hydro.core.explanation.ladder import best
    from hydro.core.explanation.options import is_stated
    from hydro.core.explanation.status import corrections, study_status
    from hydro.core.recording.segments import sample_time

    hull, beyond = _hull(vehicle, before, model, discover=discover), discovered if discover else None
    told = steps(
        vehicle,
        raw,
        holdout=holdout,
        hull=hull,
        beyond=beyond,
        corrected=correct_thrusters,
        wanted=add,
        progress=progress,
    )
    rungs: list[Rung] = []
    done: list[Step] = []
    for rung in told:
        stated = bool(rungs) and is_stated(rungs[-1], rung)
        rungs.append(rung)
        done.append(Step.of(rung, stated, changed=hull is not None))
        if on_step is not None:
            on_step(done[-1])
    chosen, dt = best(rungs), sample_time(raw)
    answer = study_status(rungs, chosen, dt, hull).headline
    sentences = corrections(rungs, chosen, dt, hull)
    return Study.of(done, chosen.number, ending(rungs, add), answer, sentences)


def _hull(
    vehicle: Vehicle, before: pl.DataFrame | None, model: Model | None, *, discover: bool = False
) -> Hull | None:
    """Return the hull-force model of a recording before a change, or of a network; None without one."""
    from hydro.core.diagnosis.pipeline import hull_of
    from hydro.core.errors import UsageError
    from hydro.core.residual.learnt import Learnt

    if before is None:
        if model is not None:
            raise UsageError("model needs before, which says how much the network leaves unexplained")
        return None
    if discover:
        raise UsageError("discover is for one recording: leave out before, whose hull has a law already")
    return hull_of(vehicle, before, None if model is None else Learnt.of(model, vehicle))
