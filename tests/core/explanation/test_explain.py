"""Explaining simulated recordings: the ladder falls to the noise, and stops where nothing is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from scipy.optimize import brentq
from scipy.signal import lfilter

from hydro.core.columns import POSE, VELOCITY
from hydro.core.diagnosis.baseline import Outcome, refit, stable_shots, weighed_fit
from hydro.core.diagnosis.by_likelihood import refine
from hydro.core.diagnosis.confidence import left_out_costs
from hydro.core.diagnosis.findings import Diagnosis, Finding, extended
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.model import unfitted
from hydro.core.diagnosis.settings import FAR_FROM_NOISE, FIT
from hydro.core.errors import DataError
from hydro.core.explanation import explain as module
from hydro.core.explanation import screening, trials
from hydro.core.explanation.explain import ending, explain
from hydro.core.explanation.ladder import HORIZON, LEFT_OUT, Step, best, best_step, left_out_rung
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.io import schema
from hydro.io import vehicle as files

CURRENT = {"name": "ocean_current", "v_N": 0.2, "v_E": -0.15}
DAMPING = ["linear_damping", "quadratic_damping"]
WEAK = {"name": "thruster_gain", "g": [0.0, 0.0, 0.0, 0.0, -0.3, 0.0, 0.0, 0.0]}


@pytest.fixture(scope="module")
def known(datasets) -> Vehicle:
    return files.read(datasets / "vehicles" / "auv151.toml")[0]


def flown(vehicle: Vehicle, seed: int, seconds: float = 32.0) -> pl.DataFrame:
    """One session: two sines of their own on each thruster, and ordinary noise of the sensors."""
    rng, t = np.random.default_rng(seed), np.arange(round(seconds / 0.02)) * 0.02
    columns = {"session": [f"run-{seed}"] * len(t), "t": t}
    for i in range(8):
        slow, fast = (
            np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in rng.uniform([0.03, 0.2], [0.15, 0.6])
        )
        columns[f"cmd_{i + 1}"] = 0.5 * slow + 0.3 * fast
    moved = simulate(vehicle, pl.DataFrame(columns))
    logged = disturb(moved.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
    return moved.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))


def hovering(vehicle: Vehicle, seed: int, load: float) -> pl.DataFrame:
    """One session of a vehicle with quadratic thrust whose mean thrust down balances a load up [N]."""
    raw, most = flown(vehicle, seed, 1.0), 4 * 155.0  # T5 to T8 push down, with so much [N] together
    t, rng = np.arange(1100) * 0.02, np.random.default_rng(seed)
    moving = 0.2 * sum(
        np.sin(2 * np.pi * f * t[:, None] + rng.uniform(0, 6, 8))
        for f in rng.uniform([[0.03] * 8, [0.2] * 8], [[0.15] * 8, [0.6] * 8])
    )
    down = moving[:, 4:]
    trim = brentq(lambda c: most * np.mean((c + down) * np.abs(c + down)) - load, 0.0, 1.0)
    moving[:, 4:] += trim
    commands = {f"cmd_{i + 1}": moving[:, i] for i in range(8)}
    session = pl.DataFrame({"session": [f"run-{seed}"] * len(t), "t": t, **commands})
    moved = simulate(vehicle, session)
    logged = disturb(moved.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
    return moved.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY])).select(raw.columns)


def test_a_thrust_curve_is_added_together_with_the_buoyancy_that_it_balances(known, monkeypatch):
    """Alone it would take the standing thrust away, and the vehicle would rise or sink.

    Of the effects that promise anything, only those of the thrusters are tried: others would only take time.
    """
    promising, tried = trials.Recordings.promising, ("thruster_curve", "thruster_gain", "thruster_deadband")
    monkeypatch.setattr(
        trials.Recordings,
        "promising",
        lambda *given: [one for one in promising(*given) if one["name"] in tried],
    )
    hidden = [{"name": "thruster_curve", "da": 1.0}, {"name": "net_buoyancy", "dB": 40.0}]
    true = extended(known, hidden)
    load = 40.0 + known.buoyancy.force - known.rigid_body.mass * known.environment.gravity
    raw = pl.concat([hovering(true, seed, load) for seed in (21, 22)])
    told = iter([[finding("far_from_noise")], [finding("nothing_missing")]])
    monkeypatch.setattr(
        module, "diagnose_log", lambda vehicle, *_, **__: Diagnosis(tuple(next(told)), vehicle, (9e9,) * 3)
    )
    first, second = explain(known, raw)
    assert set(second.added) == {"thruster_curve", "net_buoyancy"}
    (curve,), (load_found,) = (second.vehicle.effects(one["name"]) for one in hidden)
    assert curve["da"] == pytest.approx(1.0, abs=0.1)
    assert load_found["dB"] == pytest.approx(40.0, abs=4.0)
    row = second.ladder.filter(dataset="fit", axis="all", horizon=HORIZON)
    assert row["rmse"][0] < 1.5 * row["noise_floor"][0]
    assert first.error("fit") > 5.0 * row["rmse"][0]


@pytest.fixture(scope="module")
def study(known) -> list[Step]:
    """Two effects hidden in 48 s; 24 s held out."""
    true = extended(known, [CURRENT, WEAK])
    raw = pl.concat([flown(true, seed, 24.0) for seed in (1, 2)])
    return list(explain(known, raw, holdout=flown(true, 3, 24.0)))


@pytest.mark.slow
def test_each_step_adds_one_hidden_effect_and_lowers_the_held_out_error(study):
    assert [step.number for step in study] == [0, 1, 2]
    assert {step.added for step in study[1:]} == {("ocean_current",), ("thruster_gain",)}
    for dataset in ("fit", "holdout"):
        errors = [step.error(dataset) for step in study]
        assert errors[0] > errors[1] > errors[2]
        assert errors[0] > 5.0 * errors[2]
        last = study[-1].ladder.filter(dataset=dataset, axis="all", horizon=5.0)
        assert last["rmse"][0] < 1.15 * last["noise_floor"][0]
    assert ending(study) == "nothing more is found"
    assert best(study) is study[-1]


@pytest.mark.slow
def test_all_added_effects_are_fitted_together(study):
    assert [{table["name"] for table in step.tables} for step in study[1:]] == [
        {"linear_damping", "quadratic_damping", *study[1].added},
        {"linear_damping", "quadratic_damping", "ocean_current", "thruster_gain"},
    ]
    (current,), (weak,) = (study[-1].vehicle.effects(one["name"]) for one in (CURRENT, WEAK))
    for name in ("v_N", "v_E"):
        assert current[name] == pytest.approx(CURRENT[name], abs=4.5 * current["standard_error"][name])
    np.testing.assert_array_less(
        np.abs(np.subtract(weak["g"], WEAK["g"])), 4.5 * np.array(weak["standard_error"]["g"])
    )


@pytest.mark.slow
def test_the_ladder_fits_its_schema(study):
    ladder = pl.concat(step.ladder for step in study)
    schema.load("ladder").check(ladder, "ladder")
    horizons = ladder.filter(axis="u", dataset="fit", step=1)["horizon"].to_list()
    assert horizons == [1.0, 5.0, 20.0, None]
    assert set(ladder.filter(step=0)["effect"]) == {""}


@pytest.mark.slow
def test_a_complete_file_ends_the_study_at_step_0(known):
    steps = list(explain(known, flown(known, 4, 40.0)))
    assert [step.number for step in steps] == [0]
    assert ending(steps) == "nothing more is found"
    assert steps[0].error("holdout") is None


def test_a_step_has_the_standard_errors_of_the_diagnosis(known):
    """One value, one standard error: noise of the velocities lasts half a second, and both weigh it so."""
    raw, rng = flown(known, 6, 60.0), np.random.default_rng(7)
    slow = lfilter([0.28], [1.0, -0.96], rng.standard_normal((raw.height, 6)), axis=0)
    size = np.repeat([0.02, 0.01], 3)
    noisy = raw.select(VELOCITY).to_numpy() + size * slow
    log = preprocess(known, raw.with_columns(pl.DataFrame(noisy, schema=list(VELOCITY))))
    baseline = refit(known, log, stable_shots(known, log), known)
    assert not np.array_equal(baseline.problem.shots.sigma, log.noise)
    told = refine(baseline, Outcome(baseline.refitted, (), None)).fit
    tables = trials._fit_together(known, SimpleNamespace(log=log), baseline.effects, known).tables()
    for table, other in zip(tables, told.tables(), strict=True):
        np.testing.assert_allclose(
            table["standard_error"]["diagonal"], other["standard_error"]["diagonal"], rtol=0.05
        )


def test_far_from_the_noise_the_better_predicting_fit_is_used(known):
    """Damping alone cannot be what a current and weak thrusters do; weighed by noise attitude decides it."""
    raw = flown(extended(known, [CURRENT, WEAK]), 8, 60.0)
    recordings = trials.Recordings.of(known, raw, None, None)
    model, _, _ = weighed_fit(known, DAMPING, stable_shots(known, recordings.log), recordings.log, share=0.0)
    taken = trials._fit_together(known, recordings, DAMPING, known).vehicle
    assert model.normal.chi2 > FIT
    taken_error, other = (recordings.error(recordings.left_out(one, [])) for one in (taken, model.vehicle))
    assert taken_error <= 1.001 * other


# What follows replaces the three computations by tables, to see the loop alone.


def finding(verdict: str, name: str = "", **values: float) -> Finding:
    return Finding(verdict, name, (name,), 0.5, parameters=values, standard_errors=dict.fromkeys(values, 0.1))


@pytest.fixture
def staged(monkeypatch, known):
    """A study whose diagnoses and held-out errors are given; what every fit was asked for is noted."""
    asked: list[list] = []
    in_vain_of_steps: list[bool] = []

    def run(
        diagnoses: list[list[Finding]], held_out: list[float], chi2: Sequence[float] = (), **how
    ) -> list[Step]:
        noises = list(chi2) or [1.0] * len(diagnoses)
        left, errors = list(diagnoses), [error for error in held_out for _ in range(2)]

        def together(vehicle, recordings, wanted, file, tried=None):
            asked.append(list(wanted))
            names = [one if isinstance(one, str) else one["name"] for one in wanted]
            given = {one["name"]: one for one in wanted if not isinstance(one, str)}
            fitted = tuple({"name": n, "standard_error": {}} | given.get(n, {}) for n in names)
            return SimpleNamespace(tables=lambda: fitted, estimates=lambda: None)

        def compare(vehicle, raw, record, yardstick, progress):
            row = dict.fromkeys(("low", "high", "noise_floor"), 0.1) | {"level": "replay", "by": "all"}
            row |= {"axis": "all", "horizon": 5.0, "rmse": errors.pop(0), "unit": "m/s"}
            return pl.DataFrame([row])

        monkeypatch.setattr(trials, "_fit_together", together)
        monkeypatch.setattr(trials, "compare", compare)

        def diagnose(vehicle, log, progress, hull, further, file, in_vain, beyond, provisional):
            in_vain_of_steps.append(in_vain)
            return Diagnosis(tuple(left.pop(0)), vehicle, (9e9, 9e9, noises.pop(0)))

        monkeypatch.setattr(module, "diagnose_log", diagnose)
        quiet = flown(known, 5, 6.0)
        return list(explain(known, quiet, holdout=quiet, **how)), asked

    run.in_vain = in_vain_of_steps
    return run


def test_new_values_are_fitted_with_the_missing_effect(staged):
    missing = finding("missing", "ocean_current", v_N=0.2)
    steps, asked = staged([[missing, finding("retune", "linear_damping", d=1.0)], []], [2.0, 1.0])
    assert [step.added for step in steps] == [(), ("ocean_current",)]
    begun = {"name": "linear_damping", "d": 1.0}
    assert asked == [["quadratic_damping", {"name": "ocean_current", "v_N": 0.2}, begun]]


def test_new_values_without_a_missing_effect_make_one_step(staged):
    again = [finding("retune", "quadratic_damping", diagonal=1.0)]
    steps, asked = staged([again, again], [2.0, 1.0])
    assert [step.added for step in steps] == [(), ("quadratic_damping",)]
    assert asked == [["linear_damping", {"name": "quadratic_damping", "diagonal": 1.0}]]
    assert ending(steps) == "nothing more is found"


def test_a_step_that_raises_the_held_out_error_ends_the_study(staged):
    more = [[finding("missing", name, w=1.0)] for name in ("payload", "net_buoyancy", "tether")]
    steps, _ = staged(more, [2.0, 1.0, 1.1])
    assert [step.number for step in steps] == [0, 1, 2]
    assert "worse than step 1" in ending(steps)
    assert best(steps) is steps[1]


def test_a_search_that_failed_far_from_the_noise_is_not_repeated(staged):
    missing = [[finding("missing", name, w=1.0)] for name in ("payload", "net_buoyancy")]
    steps, _ = staged([*missing, []], [3.0, 2.0, 1.0], chi2=[2 * FAR_FROM_NOISE, 0.5 * FAR_FROM_NOISE, 1.0])
    assert len(steps) == 3
    assert staged.in_vain == [False, True, False]


def test_a_study_ends_at_the_maximum_number_of_steps(staged, monkeypatch):
    monkeypatch.setattr(module, "MOST_STEPS", 2)
    names = ("payload", "net_buoyancy", "tether", "body_lift")
    steps, _ = staged([[finding("cannot_tell_apart", name, w=1.0)] for name in names], [4.0, 3.0, 2.0, 1.0])
    assert len(steps) == 3
    assert "2 steps are the limit" in ending(steps)


def test_a_study_ends_with_the_error_that_no_effect_explains(staged):
    steps, _ = staged([[finding("none_of_the_known")]], [1.0])
    assert ending(steps) == "no effect of the catalogue explains the remaining error"


def left_out(*errors: float) -> pl.DataFrame:
    """A ladder whose steps leave these errors of stretches left out of the fit."""
    rows = {"step": range(len(errors)), "dataset": "fit", "axis": LEFT_OUT, "horizon": 5.0, "rmse": errors}
    return pl.DataFrame(rows)


@pytest.mark.parametrize(
    ("errors", "chosen"),
    [((3.0, 2.0), 1), ((3.0, 2.0, 2.5), 1), ((3.0, 3.01), 1), ((3.0, 2.0, 2.03, 2.06), 2)],
)
def test_without_held_out_data_the_left_out_error_selects_the_step(errors, chosen):
    assert best_step(left_out(*errors)) == chosen


def test_the_left_out_row_has_the_unit_and_the_noise_floor_of_a_velocity():
    rows = {"step": 1, "effect": "tether", "dataset": "fit", "axis": ["all", "pose", "all"], "rmse": 1.0}
    rows |= {"horizon": [HORIZON, HORIZON, 1.0], "low": 0.5, "high": 2.0, "noise_floor": [0.1, 0.2, 0.3]}
    row = left_out_rung(pl.DataFrame(rows | {"unit": ["m/s", "m", "m/s"]}), 0.4)
    found = row.select("axis", "horizon", "rmse", "low", "noise_floor", "unit").row(0)
    assert row.height == 1
    assert found == (LEFT_OUT, HORIZON, 0.4, None, 0.1, "m/s")


@pytest.fixture
def better(monkeypatch):
    """Says which effect predicts best what a fit leaves out."""

    def let(best: str, beside: Sequence[dict] = (), others: float = 0.2, refit: float = 0.2) -> None:
        def tried(_, vehicle, wanted, problem, iterations=0):
            return extended(vehicle, [{"name": one} if isinstance(one, str) else one for one in wanted])

        def error(_, vehicle, names, problem=None):
            able = {"ocean_current", "payload", "net_buoyancy", "command_delay"}
            new = able & {one["name"] for one in vehicle.effect}
            if not new:
                return refit if names else 0.2
            return 0.1 if new & set(best.split()) else others

        monkeypatch.setattr(trials.Recordings, "tried", tried)
        monkeypatch.setattr(trials.Recordings, "left_out", error)
        monkeypatch.setattr(trials.Recordings, "error", lambda _, squares: squares)
        monkeypatch.setattr(trials.Recordings, "worsened_axes", lambda *_: ())
        monkeypatch.setattr(
            trials.Recordings, "error_ahead", lambda recordings, vehicle: error(recordings, vehicle, [])
        )
        monkeypatch.setattr(trials.Recordings, "promising", lambda *_: list(beside))
        monkeypatch.setattr(trials.Recordings, "judged", lambda *_: None)
        monkeypatch.setattr(trials.Recordings, "is_far", lambda *_: False)
        monkeypatch.setattr(trials.Recordings, "started", lambda _, vehicle, effects: vehicle)

    return let


LIKELY = replace(finding("suspect", "ocean_current", v_N=0.2), confidence=0.5)


@pytest.mark.parametrize("best", ["ocean_current", "payload", "command_delay"])
def test_the_suspect_with_the_best_held_out_prediction_is_added(staged, better, best):
    better(best, beside=[{"name": "command_delay", "d": 0.1}])
    beside = replace(finding("suspect", "payload", w=1.0), confidence=0.1)
    steps, asked = staged([[LIKELY, beside], [finding("nothing_missing")]], [2.0, 1.0])
    assert [step.added for step in steps] == [(), (best,)]
    values = {"ocean_current": {"v_N": 0.2}, "payload": {"w": 1.0}, "command_delay": {"d": 0.1}}
    assert asked[-1][-1] == {"name": best} | values[best]


def test_implausible_values_are_added_only_without_an_alternative(staged, better):
    better("command_delay", beside=[{"name": "ocean_current", "v_N": 0.1}], others=0.15)
    fanciful = replace(finding("suspect", "command_delay", d=40.0), confidence=0.5)
    steps, _ = staged([[fanciful], [finding("nothing_missing")]], [2.0, 1.0])
    assert [step.added for step in steps] == [(), ("ocean_current",)]
    better("command_delay")
    steps, _ = staged([[fanciful], [finding("nothing_missing")]], [2.0, 1.0])
    assert [step.added for step in steps] == [(), ("command_delay",)]


def test_a_simpler_effect_is_added_if_it_predicts_equally_well(staged, better):
    """All that shows of a payload may be its weight."""
    better("payload net_buoyancy")
    suspect = replace(finding("suspect", "payload", w=2.0), confidence=0.5)
    steps, asked = staged([[suspect], [finding("nothing_missing")]], [2.0, 1.0])
    assert [step.added for step in steps] == [(), ("net_buoyancy",)]
    assert asked[-1][-1] == {"name": "net_buoyancy", "dB": -2.0}


def test_a_candidate_with_implausible_fitted_values_is_replaced_by_the_next(staged, better, monkeypatch):
    better("command_delay", beside=[{"name": "ocean_current", "v_N": 0.1}], others=0.15)
    quick_or_last = iter([[], [], [], ["beyond belief"], ["beyond belief"], []])
    monkeypatch.setattr(trials, "implausible", lambda *_: next(quick_or_last))
    suspect = replace(finding("suspect", "command_delay", d=0.1), confidence=0.5)
    steps, asked = staged([[suspect], [finding("nothing_missing")]], [2.0, 1.0])
    assert [one[2]["name"] for one in asked] == ["command_delay", "command_delay", "ocean_current"]
    assert asked[1][3:] == ["net_buoyancy", "buoyancy_offset"]
    assert steps[1].added == ("ocean_current",)


def test_channels_are_weighted_by_the_residual_of_the_vehicle(known):
    """So that each counts alike, whatever its sensor's noise, as nearly as free beginnings let it."""
    hidden = extended(known, [CURRENT, WEAK])
    recordings = trials.Recordings.of(known, flown(hidden, 10, 90.0), None, None)
    ahead = recordings.ahead(known, 8)
    assert ahead is not None
    assert (len(ahead.shots.starts), round(ahead.shots.length * 0.02)) == (8, HORIZON)
    left = unfitted(known, ahead).normal.rms
    assert ((left > 0.5) & (left < 2.0)).all()
    assert np.ptp(np.log(ahead.shots.sigma / recordings.log.noise)) > np.log(4.0)


def test_a_suspect_without_a_better_held_out_prediction_is_reported_but_not_added(staged, better):
    better("", beside=[{"name": "command_delay", "d": 0.1}])
    steps, _ = staged([[finding("suspect", "ocean_current", v_N=0.2), finding("far_from_noise")]], [1.0])
    assert [step.added for step in steps] == [()]
    assert ending(steps) == f"{module.NO_BETTER}; unconfirmed, and not added: ocean_current"


def test_a_suspect_is_not_added_if_refitted_file_values_predict_equally_well(staged, better):
    """Damping that is far off hides behind whatever is fitted together with it."""
    better("ocean_current", refit=0.101)
    steps, _ = staged([[LIKELY, finding("far_from_noise")]], [2.0])
    assert [step.added for step in steps] == [()]


def test_a_stated_effect_is_added_even_without_a_better_prediction(staged, better):
    better("")
    stated = finding("cannot_tell_apart", "payload", w=1.0)
    steps, _ = staged([[LIKELY, stated], [finding("nothing_missing")]], [2.0, 1.0])
    assert [step.added for step in steps] == [(), ("payload",)]


def test_of_two_equal_predictions_the_simpler_effect_is_added(staged, better):
    """A current of the water's three numbers, and a delay of one that predicts 1 % worse."""
    better("ocean_current", beside=[{"name": "command_delay", "d": 0.1}], others=0.101)
    steps, _ = staged([[LIKELY], [finding("nothing_missing")]], [2.0, 1.0])
    assert [step.added for step in steps] == [(), ("command_delay",)]


def test_a_suspect_that_explains_more_than_the_stated_effect_is_tried_too(staged, better):
    stated = finding("cannot_tell_apart", "payload", w=1.0)
    for order, added in (([LIKELY, stated], "ocean_current"), ([stated, LIKELY], "payload")):
        better("ocean_current")
        steps, _ = staged([order, [finding("nothing_missing")]], [2.0, 1.0])
        assert [step.added for step in steps] == [(), (added,)]


def test_an_unlikely_suspect_is_reported_but_not_tried(staged):
    unlikely = replace(LIKELY, confidence=0.1)
    steps, _ = staged([[unlikely, finding("none_of_the_known")]], [1.0])
    assert ending(steps) == (
        "no effect of the catalogue explains the remaining error; unconfirmed, and not added: ocean_current"
    )


def first_plain(recordings, vehicle):
    """The three most promising effects; drag of the whole hull, which replaces plain damping, left out."""
    names = [one["name"] for one in recordings.promising(vehicle, [])]
    return {*[name for name in names if name != "ellipsoid_drag"][:3]}


def test_damping_is_the_most_promising_effect_of_a_file_without_damping(known):
    """By one step of all effects about the bare file, damping that it lacks; and what is there it is not."""
    bare = known.without("linear_damping").without("quadratic_damping")
    recordings = trials.Recordings.of(bare, flown(known, 9, 60.0), None, None)
    assert first_plain(recordings, bare) & {*DAMPING, "power_drag"}
    assert not {one["name"] for one in recordings.promising(known, DAMPING)} & {*DAMPING}


def test_a_study_resumes_after_completed_steps(staged):
    found = [[finding("missing", "payload", w=1.0)], [finding("missing", "tether", k=1.0)], []]
    steps, _ = staged(found, [3.0, 2.0, 1.0])
    rest, asked = staged(found[2:], [1.0], done=steps[:2])
    assert [step.number for step in rest] == [2]
    assert asked[-1] == ["linear_damping", "quadratic_damping", "payload", {"name": "tether", "k": 1.0}]
    assert rest[0].ladder.equals(steps[2].ladder)
    assert staged([], [], done=steps)[0] == []


def test_the_recordings_are_preprocessed_once_for_all_steps(staged, monkeypatch):
    logs = []
    monkeypatch.setattr(trials, "preprocess", lambda *given: logs.append(preprocess(*given)) or logs[-1])
    steps, _ = staged([[finding("missing", "payload", w=1.0)], []], [2.0, 1.0])
    assert len(steps) == 2
    assert len(logs) == 1


def test_a_diverging_shot_does_not_hide_an_effect(known, monkeypatch):
    """What the others promise counts."""
    bare = known.without("linear_damping").without("quadratic_damping")
    recordings = trials.Recordings.of(bare, flown(known, 9, 60.0), None, None)

    def lost(*given, **named):
        costs = left_out_costs(*given, **named)
        costs[0] = np.inf
        return costs

    monkeypatch.setattr(screening, "left_out_costs", lost)
    assert first_plain(recordings, bare) & {*DAMPING, "power_drag"}


@pytest.mark.parametrize(
    ("change", "words"), [("cmd_8", "7 command columns"), (None, "no session lasts 5 s")]
)
def test_an_unsuitable_held_out_recording_raises_an_error(known, change, words):
    raw = flown(known, 6, 6.0)
    other = raw.drop(change) if change else raw.head(200)
    with pytest.raises(DataError, match=words):
        next(explain(known, raw, holdout=other))
