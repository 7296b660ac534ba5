"""The hull that is learnt from a recording before; `tests/test_before_command.py` names changes beside it."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import WEAK, damped, flown

from hydro.core.diagnosis import by_change as before_
from hydro.core.diagnosis import contenders, log_faults
from hydro.core.diagnosis.by_change import Change, Changes
from hydro.core.diagnosis.contenders import Compared, Contender, Contest
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.pipeline import diagnose, diagnose_log, hull_of
from hydro.core.diagnosis.settings import CONTENDERS, DOUBTFUL, RIGHT, SURE
from hydro.core.errors import DataError
from hydro.core.identification.levenberg_marquardt import ITERATIONS
from hydro.core.identification.outcome import Fit
from hydro.core.prediction.parameters import free
from hydro.core.vehicle.description import told_apart
from hydro.report import change

FIN = {
    "name": "control_surface",
    "area": 0.4,
    "position": [-0.5, 0.0, 0.0],
    "roll": 0.0,
    "deflection": 0.0,
    "stall": 0.3,
}


EXCHANGED = {"cmd_1": pl.col("cmd_2"), "cmd_2": pl.col("cmd_1")}
GAINS = "thruster_gain"
OFFSET = {"name": "buoyancy_offset", "dx": 0.0, "dy": -0.05, "dz": 0.02}


@pytest.fixture(scope="module")
def before():
    return flown(seed=10)


@pytest.fixture(scope="module")
def hull(before):
    """What the hull does beside the file of `damped`."""
    return hull_of(damped(), before)


@pytest.fixture(scope="module")
def drag(before):
    """What the hull does beside a file without any drag."""
    return hull_of(synthetic.vehicle(), before)


def half(raw):
    """Two of the four sessions of a recording."""
    return raw.filter(pl.col("session") < "s2")


def diagnosed(vehicle, raw, hull):
    """Diagnose a recording beside a hull that is known already."""
    return diagnose_log(vehicle, preprocess(vehicle, raw, hull), hull=hull)


def test_a_change_is_sought_on_some_predictions_of_a_long_recording(before, hull, monkeypatch):
    """They are spread evenly over it."""
    monkeypatch.setattr(contenders, "SHOTS", 10)
    log = preprocess(damped(), before, hull)
    compared, first = Compared.of(damped(), log, hull)
    starts = compared.problem.shots.starts
    assert len(starts) == len(compared.weight) == len(first.costs) == 20
    assert set(compared.problem.shots.segment) == set(range(len(log.record.segments)))


LATE = {"name": "command_delay", "d": 0.02}


def delayed(file, error, **options):
    """The finding of a clear change of the delay to 0.2 s, with a standard error."""
    fit = Fit(
        vehicle=damped(LATE | {"d": 0.2}),
        free=free(damped(LATE), ["command_delay"], reach=np.zeros((1, 3))),
        values=np.array([0.2]),
        standard_errors=np.array([error]),
        covariance=np.array([[error**2]]),
        determined=np.array([True]),
        chi2=1.0,
        method="output",
        warnings=(),
    )
    model = cast(Any, SimpleNamespace(vehicle=file, values=np.zeros(1)))
    best = Contender("command_delay", model, np.full(8, 1e-3))
    found = Change(best, {"command_delay": best}, np.full(8, 100.0), 8.0)
    return before_._finding(found, file, fit, 0.02, 100.0, 1.0, **options)


@pytest.mark.parametrize(("error", "verdict"), [(0.01, "retune"), (0.2, "suspect")])
def test_a_changed_value_within_its_standard_error_is_unconfirmed(error, verdict):
    assert delayed(damped(LATE), error).verdict == verdict


def test_values_near_no_change_weigh_against_an_effect():
    """Three values cost three: a current of one standard error is likelier none, one of five is clear."""

    def weight(effect, values, error):
        spread = error**2 * np.eye(len(values))
        fit = SimpleNamespace(free=free(damped(), [effect]), values=np.array(values), covariance=spread)
        return before_.weight_of_values(cast(Any, fit), damped(), effect)

    assert weight("ocean_current", [0.04, 0.0, 0.0], 0.04) == pytest.approx(1 / (1 + np.exp(2.5)))
    assert weight("ocean_current", [0.2, 0.1, 0.0], 0.04) > 0.999
    assert weight("surface_suction", [30.0, 0.5], 60.0) == 1.0


def test_a_change_whose_values_are_likelier_unchanged_is_refused(monkeypatch):
    """The last change has a value of one standard error, the first of ten."""
    model = cast(Any, SimpleNamespace(vehicle=damped(), unknown=SimpleNamespace(entries=())))
    first, last = (
        Change(Contender(name, model, np.ones(8)), {}, np.ones(8), 1.0) for name in (GAINS, "tether")
    )
    weights_ = {GAINS: 0.99, "tether": 0.4}
    monkeypatch.setattr(before_, "joint_fit", lambda *_: "fit")
    monkeypatch.setattr(before_, "weight_of_values", lambda fit, file, name: weights_[name])
    search = before_.ByChange(damped(), cast(Any, None), model, 1.0)
    assert search.shown(Changes((first, last))) == Changes((first,), last, cast(Any, "fit"))
    assert search.shown(Changes((last,), first)) == Changes((), last)


@pytest.mark.parametrize(
    ("given", "left", "describes"), [(200.0, 6.0, True), (1.0, 1.1, True), (12_000.0, 17_000.0, False)]
)
def test_no_change_is_certain_beside_a_hull_model_that_predicts_worse_than_the_file(
    hull, given, left, describes
):
    assert replace(hull, given=given, left=left).describes == describes
    for file, verdict in ((damped(), "missing"), (damped(LATE), "retune")):
        assert delayed(file, 0.01).verdict == verdict
        doubted = delayed(file, 0.01, most=DOUBTFUL)
        assert (doubted.verdict, doubted.confidence) == ("suspect", DOUBTFUL)
    told = change.learnt({"recording": "earlier", "given": given, "left": left})
    assert ("no change is certain" in told) == (not describes)


def test_the_hull_model_halves_the_residual_of_the_file(hull):
    assert hull.left < 0.5 * hull.given, "the library takes most of the file's error away"


def test_a_too_short_earlier_recording_raises_an_error(before):
    with pytest.raises(DataError, match=r"too short|too few"):
        hull_of(damped(), before.head(1000))


class _Nothing:
    """Hull-force model that has learnt nothing."""

    def wrench(self, vehicle, shots, rows=None):
        return np.zeros((len(shots.record.t), 6))


def test_an_effect_that_the_earlier_recording_needs_as_well_is_no_change(before):
    """Beside a hull model that fails, any effect that the file lacks looks like a change."""
    bare = synthetic.vehicle()
    failed = hull_of(bare, half(before), _Nothing())
    found = diagnosed(bare, half(flown(seed=70)), failed)
    (finding,) = found.findings
    assert (finding.verdict, finding.effect) == ("none_of_the_known", "")
    assert set(finding.members) & {"linear_damping", "quadratic_damping"}
    assert f"Fit {finding.members[0]} to the earlier recording" in finding.advice
    assert "VEHICLE" not in finding.advice, "a placeholder"
    assert found.status.headline.startswith("No change can be named: The earlier recording needs ")


def test_a_changed_nonlinear_effect_of_the_file_is_named():
    late = {"name": "command_delay", "d": 0.02}
    later = late | {"d": 0.2}
    found = diagnose(damped(late), half(flown(later, seed=40)), before=flown(late, seed=10)).findings[0]
    assert (found.verdict, found.effect) == ("retune", "command_delay")
    assert found.confidence >= SURE
    assert found.parameters["d"] == pytest.approx(0.2, abs=4.0 * found.standard_errors["d"] + 1e-3)


def test_a_tether_that_only_a_finer_grid_shows_is_named(hull, monkeypatch):
    """A cable's coarse places may say nothing of it: the pull of one with slack is not linear in them."""
    cable = {
        "name": "tether",
        "k": 30.0,
        "slack": 4.0,
        "attachment": [-0.3, 0.0, 0.0],
        "anchor": [1.0, -3.0, 9.0],
    }
    stepped = Contest.scored_by_one_step

    def blind(contest, tried):
        ranked = stepped(contest, tried)
        if GAINS in ranked and cable["name"] in ranked:  # all effects at once, at their coarse places
            _, table = ranked.pop(cable["name"])
            ranked[cable["name"]] = (-1.0, table)
        return ranked

    monkeypatch.setattr(Contest, "scored_by_one_step", blind)
    found = diagnosed(damped(), half(flown(cable, seed=40)), hull).findings[0]
    assert (found.verdict, found.effect) == ("missing", "tether")


def test_fits_that_have_not_converged_continue_if_every_candidate_leaves_a_large_residual(hull, monkeypatch):
    """The fit of the change itself, which turns the vehicle over, has converged by then."""
    fit, least = contenders.fit_model, contenders._least
    quick, long, first_change = set[str](), list[str](), list[dict]()

    def counted(vehicle, tables, problem, reach, iterations):
        name = str(tables[0]["name"])
        first_change.extend(vehicle.effects("buoyancy_offset"))
        if iterations == ITERATIONS:
            long.append(name)
        else:
            quick.add(name)
        return fit(vehicle, tables, problem, reach, iterations)

    monkeypatch.setattr(contenders, "fit_model", counted)
    monkeypatch.setattr(contenders, "_least", lambda fits: least(fits) if first_change else np.inf)
    found = diagnosed(damped(), flown(OFFSET, seed=40, rows=1000).filter(session="s0"), hull)
    assert (found.findings[0].verdict, found.findings[0].effect) == ("missing", "buoyancy_offset")
    assert len(set(long)) == len(long) >= 2
    assert "buoyancy_offset" not in long
    assert len(quick) > 2 * CONTENDERS


def test_a_large_change_of_balance_is_the_only_finding(hull):
    """What the hull does beside the file moves a vehicle of another drag or balance otherwise."""
    found = diagnosed(damped(), half(flown(OFFSET, seed=40)), hull)
    assert [(one.verdict, one.effect) for one in found.findings] == [("missing", "buoyancy_offset")]
    assert found.findings[0].confidence >= SURE
    assert found.chi2[2] < RIGHT, "no more is left than the law of the hull leaves"


def test_the_turned_one_of_two_fins_is_named():
    stern, rudder = FIN | {"label": "stern"}, FIN | {"label": "rudder", "roll": np.pi / 2}
    file = told_apart(damped(stern, rudder))
    earlier, later = flown(stern, rudder, seed=10), flown(stern, rudder | {"deflection": 0.2}, seed=40)
    found = diagnose(file, half(later), before=earlier).findings[0]
    assert (found.verdict, found.effect) == ("retune", "control_surface:rudder")
    assert found.confidence >= SURE
    assert found.parameters["deflection"] == pytest.approx(0.2, abs=0.03)
    assert {name: found.parameters[name] for name in ("area", "roll", "stall")} == {
        name: rudder[name] for name in ("area", "roll", "stall")
    }, "nothing else of it is free to follow the hull's error"
    told = re.search(r"control_surface:rudder\.deflection from 0 to ([\d.]+);", found.advice)
    assert told is not None
    assert float(told[1]) == pytest.approx(found.parameters["deflection"], rel=0.01)


def test_sensor_errors_of_the_earlier_recording_are_known_from_its_tests(before, hull, monkeypatch):
    """The model of the hull keeps them, so that a recording of hours is not tested twice."""
    tests = preprocess(damped(), before).sensors
    assert set(hull.sensors) == set(tests)
    for name, test in tests.items():
        np.testing.assert_array_equal(hull.sensors[name].estimate, test.estimate)
    seen = list[Any]()
    monkeypatch.setattr(before_, "kinematic_tests", lambda record: seen.append(record) or tests)
    log = preprocess(damped(), half(before), hull)
    assert before_.ByChange.of(damped(), log, hull).errors == ()
    assert not seen
    assert before_.ByChange.of(damped(), log, replace(hull, sensors=None)).errors == ()
    assert len(seen) == 1


def test_a_turned_dvl_is_named_by_kinematics(hull):
    """Far below what the model of the hull leaves, and whatever else has changed."""
    raw, yaw = flown(WEAK, seed=40), 0.06
    u, v = pl.col("u"), pl.col("v")
    turned = raw.with_columns(u * np.cos(yaw) + v * np.sin(yaw), v * np.cos(yaw) - u * np.sin(yaw))
    log, thruster = diagnosed(damped(), half(turned), hull).findings[:2]
    assert (log.verdict, log.effect) == ("missing", "sensor_misalignment")
    assert log.confidence >= SURE
    assert log.parameters["alpha"] == pytest.approx([0.0, 0.0, yaw], abs=0.005)
    assert "or the heading is off by -0.0" in log.advice
    assert (thruster.verdict, thruster.effect) == ("missing", "thruster_gain")


@pytest.mark.parametrize(
    ("seed", "columns", "words"),
    [
        (40, EXCHANGED, "cmd_2 drives thruster 1, cmd_1 drives thruster 2"),
        (42, {"cmd_6": -pl.col("cmd_6")}, "minus cmd_6 drives thruster 6"),
    ],
)
def test_swapped_command_columns_are_detected_with_and_without_the_drag_in_the_file(
    drag, seed, columns, words
):
    raw = flown(seed=seed).with_columns(**columns)
    for hull in (None, drag):
        log = preprocess(synthetic.vehicle(), raw, hull)
        assert log.wiring is not None
        assert log.wiring.words() == words
        assert log.raw.equals(flown(seed=seed).select(log.raw.columns))


@pytest.mark.parametrize(
    "changes",
    [
        [],
        [WEAK],
        [{"name": GAINS, "g": [0.0, -1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0]}],
        [{"name": "ocean_current", "v_N": 0.2, "v_E": 0.1}],
        [{"name": "thruster_lag", "dT": 0.4}],
    ],
)
def test_other_changes_are_not_reported_as_swapped_command_columns(drag, changes):
    assert preprocess(synthetic.vehicle(), flown(*changes, seed=40), drag).wiring is None


@pytest.mark.parametrize("known_hull", [True, False])
def test_columns_keep_their_order_where_the_exchanged_ones_predict_worse(hull, monkeypatch, known_hull):
    """A missing force, or the error of a hull-force model, can look like an exchange of columns."""
    raw, beside = half(flown(seed=40)), hull if known_hull else None
    exchanged = preprocess(damped(), raw.with_columns(**EXCHANGED), beside)
    assert exchanged.wiring is not None
    monkeypatch.setattr(log_faults, "audit", lambda *_, **__: exchanged.audit)
    kept = preprocess(damped(), raw, beside)
    assert kept.wiring is None
    assert kept.audit is not None
    told = [*kept.audit.lines()]
    assert told[0] == "the accelerations look as if columns 1 and 2 are swapped"
    assert told[1].startswith("predictions are worse like that")
    assert not kept.misdirected
    assert not [one for one in kept.faults if one.members == ("cmd_1", "cmd_2")]


@pytest.mark.parametrize(
    ("ratio", "alone", "beside"),
    [(0.9, False, False), (1.0, False, True), (1.5, False, True), (2.5, True, True)],
)
def test_predictions_of_a_file_alone_contradict_the_audit_only_if_they_are_clearly_worse(
    monkeypatch, ratio, alone, beside
):
    """With a hull-force model the other order has to be better; costs are equal for an ambiguous audit."""
    costs = {"plain": np.ones(9), "ordered": np.full(9, ratio)}
    monkeypatch.setattr(log_faults, "_costs", lambda vehicle, log, hull: costs[log])
    assert log_faults._contradicted(damped(), "ordered", "plain", None) is alone
    assert log_faults._contradicted(damped(), "ordered", "plain", "hull") is beside


def test_command_columns_exchanged_since_are_the_first_finding(drag):
    raw = half(flown(seed=40)).with_columns(**EXCHANGED)
    fault, *others = diagnosed(synthetic.vehicle(), raw, drag).findings
    assert (fault.verdict, fault.members) == ("log_fault", ("cmd_1", "cmd_2"))
    assert fault.confidence >= SURE
    assert GAINS not in [one.effect for one in others], "all else is told as if they were in order"
