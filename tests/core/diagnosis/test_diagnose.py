"""Diagnoses of simulated recordings: what was hidden is named, and nothing where nothing was."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import polars as pl
import pytest

from hydro.core.columns import POSE, VELOCITY
from hydro.core.diagnosis import by_likelihood
from hydro.core.diagnosis import pipeline as module
from hydro.core.diagnosis.baseline import Baseline, Found, Outcome, refit, stable_shots, stable_start
from hydro.core.diagnosis.by_likelihood import _retuned, refine, searched
from hydro.core.diagnosis.findings import Diagnosis, tables
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.model import Diverges, Model, fit_model
from hydro.core.diagnosis.pipeline import diagnose, diagnose_log
from hydro.core.diagnosis.search import Search, leader, same_way
from hydro.core.diagnosis.settings import MATERIAL, RIGHT, SHOTS, VISIBLE
from hydro.core.diagnosis.transfer import left_out_squares
from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.experiment import advice
from hydro.core.identification.levenberg_marquardt import ITERATIONS
from hydro.core.identification.outcome import with_uncertainty
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.parameters import free
from hydro.core.progress import silent
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files

CURRENT = {"name": "ocean_current", "v_N": 0.25, "v_E": -0.15, "v_D": 0.0}
ROWS = 1000  # of each of two sessions, 40 s at 50 Hz in all


@pytest.fixture(scope="module")
def known(datasets) -> Vehicle:
    return files.read(datasets / "vehicles" / "auv151.toml")[0]


def hiding(vehicle: Vehicle, *effects: dict) -> Vehicle:
    return msgspec.structs.replace(vehicle, effect=(*vehicle.effect, *effects))


def misjudged(vehicle: Vehicle) -> Vehicle:
    """The vehicle file with its quadratic damping a quarter wrong, up or down."""
    wrong = [1.25, 0.75, 1.2, 0.8, 1.25, 0.75]
    effects = [
        e | {"diagonal": [d * s for d, s in zip(e["diagonal"], wrong, strict=True)]}
        if e["name"] == "quadratic_damping"
        else e
        for e in vehicle.effect
    ]
    return msgspec.structs.replace(vehicle, effect=tuple(effects))


def flown(vehicle: Vehicle, *, seed: int = 0, session: str = "a", rows: int = ROWS, thrusters=range(8)):
    """One session: two sines of their own on each thruster, and ordinary noise of the sensors."""
    rng, t = np.random.default_rng(seed), np.arange(rows) * 0.02
    columns = {"session": [session] * rows, "t": t}
    for i in range(8):
        slow, fast = (
            np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in rng.uniform([0.03, 0.2], [0.15, 0.6])
        )
        columns[f"cmd_{i + 1}"] = (0.5 * slow + 0.3 * fast) * (i in thrusters)
    moved = simulate(vehicle, pl.DataFrame(columns))
    logged = disturb(moved.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
    return moved.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))


def recorded(vehicle: Vehicle, **how) -> pl.DataFrame:
    return pl.concat([flown(vehicle, seed=i, session=name, **how) for i, name in enumerate("ab")])


@pytest.fixture(scope="module")
def refitted(known) -> Baseline:
    """A file with wrong damping, refitted to the recording of a vehicle in a current."""
    file = misjudged(known)
    log = preprocess(file, recorded(hiding(known, CURRENT)))
    start, problem = stable_start(file, log)
    return refit(file, log, problem, start)


def test_a_change_counts_as_the_first_unless_further_is_given(known, monkeypatch):
    """Of a further change more is asked, so that whoever has one already must say so."""
    log = cast(Any, SimpleNamespace(observed=None, misdirected=False, record=SimpleNamespace(dt=0.02)))
    monkeypatch.setattr(module, "require_ready", lambda observed: None)
    monkeypatch.setattr(
        module, "ByChange", SimpleNamespace(of=lambda vehicle, log, hull, further, told: further)
    )
    taken: list[bool] = []
    monkeypatch.setattr(
        module,
        "reported",
        lambda regime, progress: taken.append(regime) or Diagnosis((), known, (1.0, 1.0, 1.0)),
    )
    hull = cast(Any, SimpleNamespace(completed=lambda vehicle: vehicle, completion=None))
    diagnose_log(known, log, hull=hull, file=known)
    diagnose_log(known, log, hull=hull, further=True, file=known)
    assert taken == [False, True]


@pytest.mark.parametrize(
    "hidden",
    [
        {"name": "ocean_current", "v_N": 0.2, "v_E": -0.1},
        {"name": "thruster_gain", "g": [0.0, 0.0, -0.4, 0.0, 0.0, 0.0, 0.0, 0.0]},
    ],
    ids=lambda hidden: hidden["name"],
)
def test_a_hidden_effect_is_named_with_its_values(known, hidden):
    """Though the damping of the file is a quarter wrong; and that is a finding too, after it."""
    found = diagnose(misjudged(known), recorded(hiding(known, hidden)))
    first, *others = found.findings
    assert (first.verdict, first.effect, first.members) == ("missing", hidden["name"], (hidden["name"],))
    assert first.share > 0.95
    assert first.confidence > 0.95
    assert first.support >= first.confidence
    assert first.p_value == pytest.approx(1 / 2000)
    pack = CATALOGUE[hidden["name"]].pack
    values, errors = (pack(dict(t), thrusters=8) for t in (first.parameters, first.standard_errors))
    assert (np.abs(values - pack(hidden, thrusters=8)) < 4.5 * errors).all()
    assert ("retune", "quadratic_damping") in {(one.verdict, one.effect) for one in others}
    assert not [one for one in others if one.verdict in ("missing", "cannot_tell_apart", "none_of_the_known")]
    given, own, end = found.chi2
    assert given > own > 2.0
    assert end == pytest.approx(1.0, abs=0.05)


def test_results_do_not_depend_on_the_number_of_threads(known, monkeypatch):
    """The suite runs each worker with one thread; what many do at once must come out the same."""
    raw, found = flown(hiding(known, CURRENT), rows=1000), []
    for threads in ("1", "4"):
        monkeypatch.setenv("HYDRO_THREADS", threads)
        found.append(diagnose(known, raw).frame())
    assert found[0].equals(found[1])


def test_progress_grows_and_names_the_tried_effect(known):
    heard: list[tuple[str, float]] = []
    diagnose(
        known,
        recorded(hiding(known, CURRENT), rows=1000),
        progress=lambda words, share: heard.append((words, share)),
    )
    shares = [share for _, share in heard]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert {"ocean_current against the residual", "ocean_current, fitted to convergence"} <= {
        words for words, _ in heard
    }


def test_a_contradicted_known_value_is_reported_but_not_refitted(known):
    """Quadratic damping a quarter wrong and held as known: no values for `add`, but which they would be."""
    wrong = misjudged(known)
    held = (t | {"known": t["name"] == "quadratic_damping"} for t in wrong.effect)
    found = diagnose(msgspec.structs.replace(wrong, effect=tuple(held)), recorded(known, rows=500))
    (told,) = (one for one in found.findings if one.effect == "quadratic_damping")
    assert (told.verdict, dict(told.parameters)) == ("retune", {})
    assert told.share > 0.9
    assert "held as known and not re-estimated, but the recording contradicts it" in told.advice
    assert found.vehicle.effects("quadratic_damping")[0]["diagonal"][1] == 195.0
    assert all(entry.effect != "quadratic_damping" for entry in found.estimates.entries)


def with_band(vehicle: Vehicle, width: float) -> Vehicle:
    thrusters = (msgspec.structs.replace(one, deadband=width) for one in vehicle.thruster)
    return msgspec.structs.replace(vehicle, thruster=tuple(thrusters))


@pytest.mark.parametrize(("true", "file"), [(0.03, 0.15), (0.15, 0.0)], ids=["narrower", "wider"])
def test_a_dead_band_is_found_although_its_derivative_at_zero_vanishes(known, true, file):
    """The cost has corners: only a search along the width comes to the true one."""
    raw = recorded(with_band(known, true))
    first = diagnose(misjudged(with_band(known, file)), raw).findings[0]
    assert (first.verdict, first.effect) == ("missing", "thruster_deadband")
    assert first.parameters["d"] == pytest.approx(true - file, abs=0.002)


def test_a_complete_file_gives_nothing_missing(known):
    found = diagnose(known, recorded(known))
    assert found.findings[0].verdict == "nothing_missing"
    assert {one.verdict for one in found.findings[1:]} <= {"not_excited"}
    table = found.frame()
    with pytest.raises(DataError, match="nothing to add"):
        tables(table)


def test_the_cause_of_an_error_far_below_the_noise_is_named(known):
    """Sway damping 3 % wrong: the error is a small part of the noise, and all that the file has wrong."""
    damping = known.effects("quadratic_damping")[0]
    wrong = damping | {"diagonal": [d * (1.03 if i == 1 else 1.0) for i, d in enumerate(damping["diagonal"])]}
    found = diagnose(hiding(known.without("quadratic_damping"), wrong), recorded(known, rows=1500))
    assert found.findings[0].verdict == "nothing_missing"
    assert 1.0 + VISIBLE < found.chi2[0] < 1.0 + MATERIAL
    told = [one for one in found.findings if one.verdict == "retune"]
    assert [one.effect for one in told] == ["quadratic_damping"]
    assert told[0].parameters["diagonal"][1] == pytest.approx(damping["diagonal"][1], rel=0.01)


def test_an_effect_is_named_after_the_faults_of_the_log(known):
    """Two command columns exchanged, a frozen DVL and spikes of a gyro: the thrusters come first."""
    raw = recorded(hiding(known, CURRENT))
    wrong = {name: raw[name].to_numpy().copy() for name in "uvwp"}
    wrong["p"][100::500] += 1.0
    for name in "uvw":
        wrong[name][700:800] = wrong[name][700]
    exchanged = {"cmd_2": pl.col("cmd_5"), "cmd_5": pl.col("cmd_2")}
    columns = (pl.Series(name, values) for name, values in wrong.items())
    found = diagnose(misjudged(known), raw.with_columns(*columns, **exchanged), corrected=True)
    faults = [one.members for one in found.findings if one.verdict == "log_fault"]
    assert faults == [("cmd_2", "cmd_5"), ("p",), ("u", "v", "w")]
    named = found.findings[len(faults)]
    assert (named.verdict, named.effect) == ("missing", "ocean_current")
    assert named.parameters["v_N"] == pytest.approx(CURRENT["v_N"], abs=0.01)
    assert found.chi2[2] == pytest.approx(1.0, abs=0.1)


def searching(known: Vehicle, raw: pl.DataFrame, sensors: dict) -> Search:
    """A search from the vehicle as it is, none of its own effects free."""
    log = preprocess(known, raw)
    problem = stable_shots(known, log)
    model = fit_model(known, [], problem, log.track, 0)
    return Search(Baseline(known, (), log, problem, model, model, sensors))


def test_a_strong_current_is_found_by_a_restart_from_the_file(datasets):
    """A vehicle with fins meets the water from elsewhere: drag and lift of its own hide the current."""
    file = files.read(datasets / "vehicles" / "remus100.toml")[0]
    true, parts = CURRENT | {"v_N": -0.6, "v_E": 0.6}, []
    for seed, session in enumerate("ab"):
        rng, t = np.random.default_rng(seed), np.arange(1000) * 0.02
        fins = {
            f"cmd_{i}": 0.3 * np.sin(2 * np.pi * rng.uniform(0.03, 0.15) * t + rng.uniform(0, 6))
            for i in range(2, 6)
        }
        commands = {"session": [session] * len(t), "t": t, "cmd_1": 0.5 + 0.2 * np.sin(0.3 * t)} | fins
        moved = simulate(hiding(file, true), pl.DataFrame(commands))
        logged = disturb(moved.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
        parts.append(moved.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY])))
    log = preprocess(file, pl.concat(parts))
    problem, own = stable_shots(file, log), [table["name"] for table in file.effect]
    model = fit_model(file, own, problem, log.track, 0)
    search = Search(Baseline(file, own, log, problem, model, model, {}), from_file=True)
    near = fit_model(file, [*own, "ocean_current"], problem, log.track, ITERATIONS)
    assert near.normal.chi2 > RIGHT
    found = search.from_distant_starts(search.baseline.at_file())["ocean_current"]
    assert found.normal.chi2 == pytest.approx(1.0, abs=0.05)
    values = found.vehicle.effects("ocean_current")[0]
    assert [values[name] for name in ("v_N", "v_E")] == pytest.approx([-0.6, 0.6], abs=0.02)


def test_a_linear_guess_that_diverges_does_not_end_the_search(known):
    search = searching(known, recorded(known, rows=1000), {})
    first, problem = search.baseline.refitted, search.baseline.problem
    screening = search.screen(first, [])
    suspect, columns = screening.ranked["net_buoyancy"]
    far = {"name": "net_buoyancy", "dB": 1e8}
    with pytest.raises(DataError, match="diverges"):
        fit_model(hiding(known, far), ["net_buoyancy"], problem, search.baseline.log.track, 0)
    wild = {**screening.ranked, "net_buoyancy": (replace(suspect, begin=lambda amounts: far), columns)}
    joined = search.joined([], replace(screening, ranked=wild), "net_buoyancy")
    assert joined.normal.cost <= first.normal.cost


def test_a_diverging_candidate_is_skipped(known, monkeypatch):
    search = searching(known, recorded(hiding(known, {"name": "net_buoyancy", "dB": 8.0}), rows=1000), {})
    first, true = search.baseline.refitted, Search.joined
    screening = search.screen(first, [])

    def joined(self, chosen, screening, name):
        if name == "net_buoyancy":
            raise Diverges("it does")
        return true(self, chosen, screening, name)

    monkeypatch.setattr(Search, "joined", joined)
    fits = search.contend(first, [], screening, silent)
    assert fits
    assert "net_buoyancy" not in fits


def test_a_diverging_joint_fit_keeps_the_previous_model(known, monkeypatch):
    def diverging(*given, **how):
        raise Diverges("it does")

    monkeypatch.setattr("hydro.core.diagnosis.by_likelihood.continue_fit", diverging)
    unknown = free(known, ["linear_damping"])
    gram = np.tile(np.eye(7), (100, 1, 1))
    normal = Normal(gram, 1, np.ones((100, 12)), np.zeros((100, 0, 7)))
    model = Model(unknown, unknown.starts[0], None, normal)
    baseline = SimpleNamespace(vehicle=known, warnings=())
    outcome = refine(baseline, Outcome(model, (), None))
    assert outcome.model.vehicle == model.vehicle
    assert [outcome.fit.chi2, len(outcome.warnings)] == [1.0, 1]


def test_a_diverging_file_is_fitted_from_an_estimate_of_its_damping(known):
    """Damping in the wrong unit, so stiff that no step of the integration holds it."""
    stiff = {"name": "linear_damping", "diagonal": [1e6] * 6}
    others = tuple(effect for effect in known.effect if effect["name"] != "linear_damping")
    wrong = msgspec.structs.replace(known, effect=(*others, stiff))
    log = preprocess(wrong, recorded(known, rows=1000))
    with pytest.raises(Diverges):
        stable_shots(wrong, log)
    start, problem = stable_start(wrong, log)
    baseline = refit(wrong, log, problem, start)
    assert baseline.vehicle == wrong
    assert baseline.refitted.normal.chi2 < 1.2
    assert "diverges" in baseline.warnings[0]


def test_a_sensor_bias_refuted_by_kinematics_is_replaced_by_forces(known, monkeypatch):
    """A bias that the log shows, and that the dynamics without what else is missing would have otherwise."""
    hidden = {"name": "net_buoyancy", "dB": 8.0}, {"name": "sensor_bias", "b": [0.05, 0.0, 0.0]}
    monkeypatch.setattr("hydro.core.diagnosis.baseline.shown", lambda test: True)
    monkeypatch.setattr(
        "hydro.core.diagnosis.search.refuted", lambda tests, effect, vehicle: effect == "sensor_bias"
    )
    search = searching(known, recorded(hiding(known, *hidden), rows=1500), {"sensor_bias": None})
    first = search.baseline.refitted
    screening = search.screen(first, [])
    assert search.baseline.material(screening.gains["sensor_bias"], first)
    fits = search.contend(first, [], screening, silent)
    assert "net_buoyancy" in fits
    assert "sensor_bias" not in fits


@pytest.mark.parametrize("times", [1.2, 80.0])
def test_implausible_new_values_are_reported_even_with_a_small_gain(known, times):
    """Damping refitted to eighty times its value, for a thousandth of what is left."""
    unknown = free(known, ["linear_damping"])
    values = unknown.starts[0] * [times, 1.0, 1.0, 1.0, 1.0, 1.0]
    change = (values - unknown.starts[0]) / unknown.scales
    gram = np.zeros((100, 7, 7))
    gram[:, :6, :6], gram[:, 6, 6] = np.eye(6) / (change @ change), 1000.0
    normal = Normal(gram, 1000, np.ones((100, 12)), np.zeros((100, 0, 7)))
    fit = with_uncertainty(unknown, values, normal, 1.0, "output")
    given = SimpleNamespace(excess=1e6)
    baseline = SimpleNamespace(vehicle=known, effects=("linear_damping",), given=given, sea=None)
    model = Model(unknown, values, None, normal)
    told = list(_retuned(baseline, SimpleNamespace(model=model, fit=fit, found=())))
    assert [one.verdict for one in told] == ["retune"] * (times == 80.0)
    for one in told:
        assert "linear_damping.diagonal[0] changes from 15 to 1.2e+03" in one.advice
        assert "times the uncertainty of the file's value" in one.advice


def test_effects_that_heave_alone_cannot_show_are_listed(known):
    """Four vertical thrusters in step: what only surge, sway and yaw would show is named as not shown."""
    t = np.arange(2 * ROWS) * 0.02
    demand = {f"cmd_{i}": (0.5 * np.sin(t) if i > 4 else 0.0 * t) for i in range(1, 9)}
    heave = simulate(known, pl.DataFrame({"session": ["a"] * len(t), "t": t, **demand}))
    rng = np.random.default_rng(0)
    logged = disturb(heave.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
    found = diagnose(known, heave.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY])))
    assert found.findings[0].verdict == "nothing_missing"
    unseen = {one.effect: one for one in found.findings if one.verdict == "not_excited"}
    assert {"body_lift", "added_mass_coriolis"} <= set(unseen)
    assert "net_buoyancy" not in unseen
    assert "drift" in unseen["body_lift"].advice
    assert not unseen["body_lift"].excited


def test_an_error_outside_the_catalogue_is_far_from_the_noise(known):
    """A current that is another one in each session."""
    parts = [
        flown(hiding(known, {"name": "ocean_current", "v_N": n, "v_E": e}), seed=i, session=f"s{i}", rows=500)
        for i, (n, e) in enumerate([(0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3)])
    ]
    first = diagnose(known, pl.concat(parts)).findings[0]
    assert first.verdict == "far_from_noise"
    assert first.share > 0.5
    assert "no effect of the catalogue explains it" in first.advice


@pytest.mark.parametrize("rows", [300, 60])
def test_a_short_recording_raises_an_error(known, rows):
    with pytest.raises(DataError, match="too short for a diagnosis; record at least 8 s"):
        diagnose(known, flown(known, rows=rows).with_columns(pl.col("z") + 10.0))


def without_every(period, whole):
    """The same without every so many rows."""
    return whole.with_row_index().filter(pl.col("index") % period != period - 1).drop("index")


def test_gaps_every_two_seconds_do_not_prevent_a_diagnosis(known):
    raw = without_every(120, recorded(hiding(known, CURRENT)))
    first = diagnose(known, raw).findings[0]
    assert (first.verdict, first.effect) == ("missing", "ocean_current")


def test_pieces_shorter_than_a_shot_raise_an_error(known):
    """Pieces of 0.4 s are shorter than any shot."""
    with pytest.raises(DataError, match="89 gaps cut the log to pieces: `hydro import` bridges"):
        diagnose(known, without_every(20, flown(known, rows=1800)))


def test_commands_of_another_vehicle_raise_an_error(known):
    with pytest.raises(DataError, match="7 command columns"):
        diagnose(known, flown(known, rows=100).drop("cmd_8"))


def test_a_delay_of_one_sample_is_called_a_convention_of_the_log():
    assert "convention" in advice.adding("command_delay", {"d": 0.02}, 0.02)
    assert "convention" not in advice.adding("command_delay", {"d": 0.1}, 0.02)


def test_the_advice_for_tied_effects_has_a_separating_motion():
    assert "all headings" in advice.separating(["ocean_current", "tether"])
    assert "tilts" in advice.separating(["net_buoyancy", "payload"])
    assert CATALOGUE["tether"].excitation in advice.separating(["tether", "thruster_lag"])


def test_far_from_the_noise_candidates_are_ranked_on_few_shots_and_fitted_to_all(known):
    """Suspects are ranked alike on a part of the shots; the models compared at last are of all of them."""
    raw = recorded(hiding(known, CURRENT), rows=SHOTS * 100 + 200)
    search = searching(known, raw, {})
    first = search.baseline.refitted
    few = search.screen(search.fewer(first), [])
    whole = search.screen(first, [])
    assert [len(few.model.costs), few.model.normal.chi2 > 2.0] == [SHOTS // 2, True]
    assert next(iter(few.ranked)) == next(iter(whole.ranked)) == "ocean_current"
    assert few.gains["ocean_current"] == pytest.approx(whole.gains["ocean_current"], rel=0.3)
    fits = search.contend(first, [], few, silent)
    assert {len(fit.costs) for fit in fits.values()} == {len(first.costs)}
    assert leader(fits) == "ocean_current"


def test_near_the_noise_candidates_are_ranked_on_all_shots(known):
    search = searching(known, recorded(known, rows=SHOTS * 100 + 200), {})
    assert search.fewer(search.baseline.refitted) is search.baseline.refitted


def test_the_held_out_error_falls_for_the_missing_effect_but_not_for_needless_ones(known):
    """Sixty seconds of a current: with it noise is left; fifteen numbers more leave no less."""
    log = preprocess(known, recorded(hiding(known, CURRENT), rows=1500))
    problem = stable_shots(known, log)
    errors = []
    for names in ([], ["ocean_current"], ["ocean_current", "cross_axis_drag"]):
        model = fit_model(known, names, problem, log.track, 8)
        errors.append(left_out_squares(model.vehicle, names, problem, log.shots(5.0)).error(np.ones(6)))
    truth = left_out_squares(hiding(known, CURRENT), [], problem, log.shots(5.0)).error(np.ones(6))
    assert errors[0] > 1.5 * truth
    assert errors[1] == pytest.approx(truth, rel=0.1)
    assert errors[2] > 0.995 * errors[1]


def test_a_small_sensor_error_does_not_end_the_search(known):
    """Kinematics shows it first, and it explains less than what is found must explain on average."""
    arm = {"name": "sensor_lever_arm", "r": [0.12, -0.12, 0.1]}
    cable = {"name": "tether", "k": 6.0, "slack": 2.3, "attachment": [0.15, -0.17, -0.04]}
    hidden = hiding(known, arm, cable | {"anchor": [1.3, -2.0, 4.0]})
    found = diagnose(misjudged(known), recorded(hidden, rows=1800))
    named = {one.effect: one for one in found.findings if one.verdict == "missing"}
    assert named.keys() == {"sensor_lever_arm", "tether"}
    assert named["sensor_lever_arm"].share < 0.25 < named["tether"].share
    assert found.chi2[-1] == pytest.approx(1.0, abs=0.05)


def test_a_fit_with_runaway_values_restarts_from_the_file(refitted):
    """A roll damping of seven hundred answers to nothing, and no step leads back from there."""
    baseline, file = refitted, refitted.vehicle
    away = [
        table | {"diagonal": [10.0, 10.0, 10.0, 700.0, 700.0, 700.0]}
        if table["name"] == "linear_damping"
        else table
        for table in file.effect
    ]
    vehicle = msgspec.structs.replace(file, effect=tuple(away))
    names = [*baseline.effects, "ocean_current"]
    quick = fit_model(hiding(vehicle, CURRENT), names, baseline.problem, baseline.log.track, 0)
    plain, again = Search(baseline), Search(baseline, from_file=True)
    assert plain.converged(quick, baseline.refitted, ["ocean_current"]).normal.chi2 > RIGHT
    found = again.converged(quick, baseline.refitted, ["ocean_current"])
    assert found.normal.chi2 == pytest.approx(1.0, abs=0.05)
    assert again.baseline.at_file().vehicle == file


def test_after_a_failed_search_names_by_transfer_come_first_far_from_the_noise(known, monkeypatch):
    """Near it a search is made all the same: less is missing than was."""
    log = preprocess(known, flown(hiding(known, CURRENT), seed=3, rows=1700))
    said = Diagnosis((), known, (9.0, 9.0, 9.0))
    monkeypatch.setattr(by_likelihood, "searched", lambda *_: pytest.fail("searched"))
    monkeypatch.setattr(module, "reported", lambda regime, progress: said)
    monkeypatch.setattr(by_likelihood, "FAR_FROM_NOISE", 1.0)
    assert diagnose_log(known, log, in_vain=True, file=known).chi2 == said.chi2
    monkeypatch.setattr(by_likelihood, "FAR_FROM_NOISE", 1e6)
    with pytest.raises(pytest.fail.Exception, match="searched"):
        diagnose_log(known, log, in_vain=True)


def test_a_search_without_a_fit_restarts_from_the_file(refitted, monkeypatch):
    search, outcome = searched(refitted, silent)
    assert not search.from_file
    grow = Search.grow

    def stuck(self, progress, **how):
        return grow(self, progress, **how) if self.from_file else Outcome(self.baseline.refitted, (), None)

    monkeypatch.setattr(Search, "grow", stuck)
    search, other = searched(refitted, silent)
    assert search.from_file
    assert other.effects == outcome.effects == ["ocean_current"]
    assert other.model.normal.chi2 == pytest.approx(outcome.model.normal.chi2, rel=1e-3)


def test_two_searches_count_as_the_same_while_they_find_the_same_effects():
    def found(effect, cost):
        return Found(effect, 0.0, {effect: SimpleNamespace(normal=SimpleNamespace(cost=cost))})

    first = [found("payload", 100.0), found("ocean_current", 10.0)]
    assert same_way([found("payload", 100.0)], first)
    assert same_way([found("payload", 130.0), found("ocean_current", 10.0)], first)
    assert not same_way([found("payload", 99.0)], first)
    assert not same_way([found("ocean_current", 100.0)], first)
    assert not same_way([*first, found("tether", 5.0)], first)


@pytest.mark.parametrize(
    ("hidden", "named"),
    [
        ({"name": "net_buoyancy", "dB": 20.0}, "net_buoyancy"),
        ({"name": "buoyancy_offset", "dx": 0.004, "dy": 0.002, "dz": 0.001}, "buoyancy_offset"),
        ({"name": "payload", "w": 25.0, "mass": 20.0, "x": 0.4, "y": 0.1, "z": 0.1}, "payload"),
    ],
    ids=lambda one: one if isinstance(one, str) else "",
)
def test_a_payload_is_replaced_by_nearly_equal_buoyancy_effects(known, hidden, named):
    log = preprocess(known, recorded(hiding(known, hidden)))
    start, problem = stable_start(known, log)
    baseline = refit(known, log, problem, start)
    begun = hiding(baseline.refitted.vehicle, {"name": "payload", "w": 5.0, "x": 0.1})
    payload = fit_model(begun, [*baseline.effects, "payload"], problem, log.track, 30)
    fits = Search(baseline).with_plainer({"payload": payload}, [])
    assert {"net_buoyancy", "buoyancy_offset"} <= fits.keys()
    assert leader(fits) == named
    assert ("payload" in fits) is (named == "payload")
