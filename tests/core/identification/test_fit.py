"""Fits against simulated truth, by scipy too; standard errors, bounds, and what is not there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import DAMPING, damped, moved, noisy
from scipy.integrate import quad
from scipy.stats import norm
from sinks import sunk

from hydro.core.cleaning.cleaned import cleaned
from hydro.core.columns import VELOCITY
from hydro.core.diagnosis.findings import extended
from hydro.core.effects import CATALOGUE, validate
from hydro.core.errors import DataError
from hydro.core.identification.fit import LOOSE, fit
from hydro.core.identification.initial_guess import initial_guesses
from hydro.core.identification.levenberg_marquardt import (
    ERRORS,
    FINER,
    linearised,
    over_standard_errors,
    searched,
)
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.multiple_shooting import costs, displaced, prepare
from hydro.core.prediction.normal_equations import Normal, covariance
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import free
from hydro.core.prediction.weak_form import Windows
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import TRUST, make_shots
from hydro.core.simulation.simulate import simulate
from hydro.io import vehicle as files


@pytest.mark.parametrize(("method", "tolerance"), [("output", 1e-3), ("equation", 0.15)])
def test_damping_of_a_vehicle_that_scipy_moved(method, tolerance):
    """The file has no damping at all; the recording is an independent solution of Fossen's equations."""
    recording = synthetic.recording()
    found = fit(synthetic.vehicle(), recording, ["linear_damping", "quadratic_damping"], method=method)
    truth = np.concatenate([synthetic.LINEAR, synthetic.QUADRATIC])
    total = found.values[:6] + found.values[6:] * 0.3  # what is felt at ordinary speeds
    expected = truth[:6] + truth[6:] * 0.3
    np.testing.assert_allclose(total, expected, rtol=tolerance)


@pytest.mark.parametrize(
    "hidden",
    [
        {"name": "ocean_current", "v_N": 0.2, "v_E": -0.1, "v_D": 0.02},
        {"name": "thruster_gain", "g": [0.0, 0.0, -0.4, 0.0, 0.1, 0.0, 0.0, 0.0]},
        {"name": "command_delay", "d": 0.073},
        {"name": "sensor_delay", "d": 0.11},
        {"name": "sensor_misalignment", "alpha": [0.02, -0.03, 0.05]},
        {"name": "fluid_memory", "K": [[30.0, 40.0, 50.0, 2.0, 5.0, 6.0]], "rates": [1.5]},
        {"name": "payload", "w": 8.0, "x": 0.3, "y": -0.1, "z": 0.2, "mass": 12.0},
    ],
    ids=lambda hidden: hidden["name"],
)
def test_one_hidden_effect_of_each_kind(hidden):
    """Force, thruster, clock, log, memory, inertia: within four standard errors, and those are small."""
    found = fit(damped(), noisy(moved(damped(hidden), rows=3000), 1), [hidden["name"]])
    truth = CATALOGUE[hidden["name"]].pack(hidden, thrusters=8)
    assert found.chi2 == pytest.approx(1.0, abs=0.04)
    assert (np.abs(found.values - truth) < 4.0 * found.standard_errors).all()
    assert found.determined.all()


@pytest.mark.parametrize(
    ("hidden", "close"),
    [
        ({"name": "payload", "w": 2.0, "x": -0.3, "y": 0.1, "z": 0.2, "mass": 1.0}, ("w", "x", "y", "z")),
        (
            {"name": "tether", "k": 3.0, "slack": 0.0, "attachment": [0.2, 0.0, 0.1], "anchor": [1, -2, 4]},
            "k",
        ),
    ],
    ids=("payload", "tether"),
)
def test_a_fit_begins_near_what_is_hidden_where_parameters_are_products(hidden, close):
    """The linear problem tells w, w x, w y, w z of a payload, k and k times the anchor of a cable."""
    truth = CATALOGUE[hidden["name"]].pack(hidden, thrusters=8)
    record = recording(damped(), moved(damped(hidden)))
    unknown = free(damped(), [hidden["name"]], reach=record.track)
    best = initial_guesses(unknown, Windows.of(record), record.track)[0]
    for entry, begun, true in zip(unknown.entries, best, truth, strict=True):
        if entry.parameter in close:
            assert begun == pytest.approx(true, rel=0.5), entry.name


def test_standard_errors_are_the_scatter_of_estimates():
    """Twelve recordings of one motion: (estimate - truth)/s.e. has a mean square near 1."""
    quiet = moved(damped(), rows=1000)
    scores = []
    for seed in range(12):
        found = fit(damped(), noisy(quiet, seed), ["linear_damping"])
        scores.append((found.values - synthetic.LINEAR) / found.standard_errors)
    assert 0.5 < np.mean(np.square(scores)) < 1.7


def test_a_dead_band_is_found_from_afar_and_to_its_standard_error():
    """Rows of commands act or do not: derivatives see cliffs, and the cost a corner."""
    hidden = {"name": "thruster_deadband", "d": 0.071}
    scores, errors = [], []
    for seed in range(2):
        recording = noisy(moved(damped(hidden), seed=seed, rows=600), seed)
        found = fit(damped(), recording, ["thruster_deadband"])
        scores.append((found.values[0] - hidden["d"]) / found.standard_errors[0])
        errors.append(found.standard_errors[0])
    assert max(errors) < 0.002
    assert np.abs(scores).max() < 4.0


def test_a_corner_scatters_by_the_variance_of_the_lowest_point_of_brownian_motion():
    """Second moment of Yao's density (1987), of which ERRORS is the root."""

    def density(x: float) -> float:
        tail = np.exp(x + norm.logcdf(-1.5 * np.sqrt(x)))
        return float(1.5 * tail - 0.5 * norm.cdf(-0.5 * np.sqrt(x)))

    assert 2.0 * quad(density, 0.0, np.inf, limit=500)[0] == pytest.approx(1.0)
    assert 2.0 * quad(lambda x: x**2 * density(x), 0.0, 400.0, limit=800)[0] == pytest.approx(ERRORS**2)


def test_beginnings_go_no_way_that_leads_off():
    """A tether that the file has not, and a hull that pulls itself ahead: shots far from linear."""
    tether = {"name": "tether", "k": 60.0, "anchor": [3.0, 2.0, 5.0]}
    raw = noisy(moved(damped(tether), rows=2000), 0)
    driven = {"name": "linear_damping", "diagonal": [-250.0, -200.0, *synthetic.LINEAR[2:].tolist()]}
    known = damped()
    known = msgspec.structs.replace(known, effect=(known.effect[0], driven, known.effect[2]))
    problem = OutputError.of(make_shots(recording(known, raw)), known)
    now = costs(prepare(candidate(known), problem.shots), problem.shots)
    normal = problem.linearise(known, [], [])
    total, along = problem.cost(known, np.zeros(0), normal)
    after = costs(prepare(candidate(known), along.shots), along.shots)
    assert total == pytest.approx(after.sum())
    assert (after <= np.maximum(now, 1.5 * np.maximum(normal.expected(np.zeros(0)), normal.freedom))).all()
    # all of the way, whatever comes of it, would have been worse for some
    whole = displaced(problem.shots.first, np.clip(normal.follow[..., -1], -3.0 * TRUST, 3.0 * TRUST))
    assert (
        costs(prepare(candidate(known), problem.shots), replace(problem.shots, first=whole)) > 1.01 * now
    ).any()


class Along:
    """A problem of one dead band, whose residuals are a function of its half-width in scales."""

    def __init__(self, left):
        self.left = left

    def linearise(self, base, moved, steps):
        e, *others = [self.left(v.effects("thruster_deadband")[0]["d"] / 0.1) for v in (base, *moved)]
        columns = [(e - other) / step for other, step in zip(others, steps, strict=True)]
        both = np.stack([*columns, e], axis=1)
        return Normal((both.T @ both)[None], 2, np.zeros((1, 1)), np.zeros((1, 0, both.shape[1])))


def test_the_search_passes_over_false_valleys():
    """Sum of squares |x - 0.3| with a ditch at 0.35 beside a cliff: the corner is found from 0.5."""
    unknown = free(damped(), ["thruster_deadband"])
    ditch = Along(lambda x: np.array([10.0, np.sqrt(abs(x - 0.3)) - (0.1 if 0.34 < x < 0.36 else 0.0)]))
    found = searched(unknown, np.array([0.05]), ditch)
    assert found[0] / 0.1 == pytest.approx(0.3, abs=2e-4)


def test_three_standard_errors_reach_what_costs_hardly_more():
    """A narrow valley at 1.0, 4 deeper than the plain from 0.2 to 1.4 around it: all of it is possible."""
    unknown = free(damped(), ["thruster_deadband"])
    plain = Along(lambda x: np.array([10.0, min(2.0, 40.0 * abs(x - 1.0)), 1e3 * max(0.2 - x, x - 1.4, 0.0)]))
    normal = over_standard_errors(
        unknown, np.array([0.1]), linearised(unknown, np.array([1.0]), plain), plain
    )
    error = np.sqrt(covariance(normal, np.array([1e-9])))[0, 0]
    assert 0.8 / FINER <= 3.0 * error <= 0.8


def test_three_standard_errors_reach_the_truth_where_a_power_is_loose():
    """Amounts go with their power exponentially: the slope at the best value made moments four errors off."""
    hidden = {"name": "power_drag", "diagonal": [12.0, 20.0, 25.0, 1.0, 2.0, 1.5], "n": 2.6}
    raw = noisy(moved(damped(hidden), rows=1500), 0)
    found = fit(damped(), raw, ["power_drag", "linear_damping", "quadratic_damping"])
    truth = np.array([*hidden["diagonal"], hidden["n"]])
    errors = found.standard_errors[:7]
    assert errors[6] > LOOSE
    assert np.abs((found.values[:7] - truth) / errors).max() < 3.0
    assert (np.abs(found.values[3:6] - truth[3:6]) > 1.5 * errors[3:6]).any(), "a tail, or it shows nothing"


def test_noise_free_data_leave_standard_errors_though_two_entries_are_all_but_one():
    """Their information is singular to the last digit; what is known beforehand is lost in rounding."""
    rng = np.random.default_rng(0)
    x = 1e9 * rng.standard_normal((40, 12, 1)) * np.array([1.0, 1.0, 1e-3])
    x[..., 1] += 1e-1 * rng.standard_normal((40, 12))
    whole = np.concatenate([x, 1e3 * rng.standard_normal((40, 12, 1))], axis=-1)
    gram = np.einsum("sni,snj->sij", whole, whole)
    normal = Normal(gram, 12, gram[:, -1, -1:], np.zeros((40, 0, 4)))
    spread = covariance(normal, np.full(3, 0.01))
    errors = np.sqrt(np.diag(spread))
    assert (errors > 0.0).all()
    assert np.isfinite(errors).all()
    correlation = spread / np.outer(errors, errors)
    np.testing.assert_allclose(correlation, correlation.T, rtol=1e-12, atol=1e-12)
    assert np.linalg.eigvalsh(correlation).min() > -1e-9


def test_the_same_data_give_the_same_fit():
    recording = noisy(moved(damped(), rows=600), 0)
    one, two = (fit(damped(), recording, ["linear_damping"]) for _ in range(2))
    np.testing.assert_array_equal(one.values, two.values)
    np.testing.assert_array_equal(one.covariance, two.covariance)


def test_what_the_data_do_not_show_stays_and_is_told(datasets):
    """Heave alone of a symmetric vehicle: yaw damping stays, with the motion that would show it."""
    known, _ = files.read(datasets / "vehicles" / "auv151.toml")
    t = np.arange(1000) * 0.02
    demand = {f"cmd_{i}": 0.5 * np.sin(t) if i > 4 else 0.0 * t for i in range(1, 9)}
    heave = simulate(known, pl.DataFrame({"session": ["a"] * 1000, "t": t, **demand}))
    found = fit(known, noisy(heave, 0), ["quadratic_damping"])
    assert found.determined.tolist() == [False, False, True, False, False, False]
    (table,) = known.effects("quadratic_damping")
    assert found.values[~found.determined].tolist() == np.array(table["diagonal"])[~found.determined].tolist()
    told = next(line for line in found.warnings if line.startswith("not determined"))
    assert "quadratic_damping.diagonal[5]" in told
    assert "it would need steady speeds" in told


def test_a_tether_that_never_pulls():
    found = fit(
        damped(),
        noisy(moved(damped(), rows=1000), 0),
        [{"name": "tether", "k": 1.0, "slack": 500.0, "anchor": [0.0, 0.0, 0.0]}],
    )
    assert not found.determined.any()
    assert found.warnings[0].startswith("not determined by these data: tether.k, tether.slack")
    assert found.warnings[0].endswith(CATALOGUE["tether"].excitation)


def test_values_stay_within_bounds():
    """A vehicle without quadratic damping: no estimate below 0, and the file stays valid."""
    known = synthetic.vehicle()
    truth = msgspec.structs.replace(known, effect=(*known.effect, DAMPING[0]))
    found = fit(truth, noisy(moved(truth, rows=1000), 3), ["quadratic_damping"])
    assert (found.values >= 0.0).all()
    assert (found.values < 5.0 * found.standard_errors).all()
    validate(found.vehicle)


def test_couplings_that_could_drive_the_hull_are_reduced():
    known = synthetic.vehicle()
    slippery = {"name": "linear_damping", "diagonal": [15.0, 2.3, 60.0, 5.0, 10.0, 1.7]}
    driven = {"name": "coupled_damping", "D15": 6.0, "D51": 6.0}
    drag = DAMPING[1]
    base = msgspec.structs.replace(known, effect=(*known.effect, slippery, drag))
    truth = msgspec.structs.replace(base, effect=(*base.effect, driven))
    found = fit(base, noisy(moved(truth, rows=800), 0), ["coupled_damping"])
    validate(found.vehicle)
    assert any("passive" in line for line in found.warnings)
    for errors in (found.standard_errors, np.full(len(found.values), 30.0)):
        rounded = replace(found, standard_errors=errors).tables()
        validate(extended(base, rounded))


def test_what_stands_beside_reduced_couplings_is_fitted_again():
    """Thrusters 30 % weaker beside impossible couplings: no other gain is better with the couplings held."""
    slippery = {"name": "linear_damping", "diagonal": [15.0, 2.0, 60.0, 5.0, 10.0, 2.0]}
    known = synthetic.vehicle()
    base = msgspec.structs.replace(known, effect=(*known.effect, slippery, DAMPING[1]))
    driven = {"name": "coupled_damping", "D15": 9.0, "D51": 9.0}
    weak = {"name": "thruster_gain", "g": [-0.3] * 8}
    truth = msgspec.structs.replace(base, effect=(*base.effect, driven, weak))
    raw = noisy(moved(truth, rows=800), 0)
    found = fit(base, raw, ["coupled_damping", "thruster_gain"])
    assert sum("passive" in line for line in found.warnings) == 1
    fixed = msgspec.structs.replace(base, effect=(*base.effect, found.vehicle.effects("coupled_damping")[0]))
    alone = fit(fixed, raw, ["thruster_gain"])
    gains = [i for i, entry in enumerate(found.free.entries) if entry.effect == "thruster_gain"]
    assert (np.abs(found.values[gains] - alone.values) < 0.5 * alone.standard_errors).all()


def test_a_long_recording_is_judged_by_some_of_its_shots():
    raw = noisy(moved(damped(), rows=2000), 0)
    every, some = (fit(damped(), raw, ["linear_damping"], most=most) for most in (None, 10))
    assert (every.share, some.share) == (1.0, 0.5)
    assert (np.abs(some.values - every.values) < 4.0 * some.standard_errors).all()
    assert (some.standard_errors > every.standard_errors).all()


def test_windows_of_a_long_recording_are_some_of_all_and_no_other():
    """A third of the windows, with a late command and a memory, which both look back on rows left out."""
    vehicle = damped(
        {"name": "command_delay", "d": 0.3},
        {"name": "fluid_memory", "K": [[30.0, 40.0, 50.0, 2.0, 5.0, 6.0]], "rates": [1.5]},
        {"name": "sensor_delay", "d": 0.1},
    )
    record = recording(vehicle, noisy(moved(vehicle, rows=2000), 0))
    every, some = Windows.of(record), Windows.of(record, most=12)
    first = every.rows[every.starts].tolist()
    kept = [first.index(row) for row in some.rows[some.starts].tolist()]
    assert len(kept) == 12
    assert some.share == pytest.approx(12 / len(first))
    assert (every.freedom, some.freedom) == (5, 9)
    assert some.rows.size < 0.7 * record.rows
    np.testing.assert_allclose(some.residuals(vehicle), every.residuals(vehicle)[kept], rtol=1e-9, atol=1e-9)


def test_equation_error_of_a_long_recording_looks_at_some_of_its_windows():
    raw = noisy(moved(damped(), rows=4000), 0)
    every, some = (
        fit(damped(), raw, ["linear_damping"], method="equation", most=most) for most in (None, 26)
    )
    assert every.share == 1.0
    assert some.share == pytest.approx(1 / 3, rel=0.05)
    assert (np.abs(some.values - every.values) < 4.0 * some.standard_errors).all()


def test_a_matrix_in_place_of_a_diagonal():
    wanted = free(damped(), ["linear_damping.matrix", "added_mass.matrix"])
    assert len(wanted.entries) == 36 + 21
    values = wanted.starts[0]
    there = wanted.at(values)
    np.testing.assert_allclose(there.effects("linear_damping")[0]["matrix"], np.diag(synthetic.LINEAR))
    assert "diagonal" not in there.effects("linear_damping")[0]
    index = next(i for i, e in enumerate(wanted.entries) if e.name == "added_mass.matrix[0][4]")
    values[index] = 7.0
    matrix = np.array(wanted.at(values).effects("added_mass")[0]["matrix"])
    assert matrix[0, 4] == matrix[4, 0] == 7.0


def test_tables_go_into_a_file_and_come_back(datasets):
    text = (datasets / "vehicles" / "auv151.toml").read_text()
    known = files.parse(text)
    found = fit(known, noisy(moved(known, rows=800), 0), ["linear_damping.matrix", "net_buoyancy"])
    for table in found.tables():
        text = files.set_effect(text, table | {"fit": {"method": "output"}})
    again = files.parse(text)
    assert "# kg, kg m^2" in text
    assert "diagonal" not in again.effects("linear_damping")[0]
    np.testing.assert_allclose(
        again.effects("net_buoyancy")[0]["dB"], found.values[-1], atol=0.01 * found.standard_errors[-1]
    )
    assert again.effects("net_buoyancy")[0]["standard_error"]["dB"] > 0.0


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ([], "name at least one effect"),
        (["linear_dampin"], "did you mean linear_damping"),
        (["net_buoyancy", "net_buoyancy"], "named twice"),
        (["net_buoyancy.matrix"], "nothing to choose"),
        ([{"name": "tether", "stiffness": 3.0}], "no such parameter"),
        (["linear_damping.square"], "diagonal, matrix"),
    ],
)
def test_wishes_that_make_no_sense(effects, message):
    with pytest.raises(DataError, match=message) as caught:
        fit(damped(), moved(damped(), rows=200), effects)
    assert "\n" not in str(caught.value)


def test_recordings_that_cannot_be_fitted():
    good = moved(damped(), rows=300)
    with pytest.raises(DataError, match="7 command columns"):
        fit(damped(), good.drop("cmd_8"), ["linear_damping"])
    with pytest.raises(DataError, match="no column w"):
        fit(damped(), good.drop("w"), ["linear_damping"])
    with pytest.raises(DataError, match="u is not finite in row 0"):
        fit(damped(), good.with_columns(u=float("nan")), ["linear_damping"])
    with pytest.raises(DataError, match="record longer"):
        fit(damped(), good[:30], ["linear_damping"])
    with pytest.raises(DataError, match="method 'guess'"):
        fit(damped(), good, ["linear_damping"], method="guess")


@pytest.mark.parametrize("kind", ["Student's t", "gross errors"])
def test_outliers_neither_bias_a_fit_nor_its_standard_errors(kind):
    """Least squares would be left with a mean squared residual of 1.2 and 1.6, and wider errors."""
    vehicle = damped()
    raw, rng = noisy(moved(vehicle, rows=4000), 1), np.random.default_rng(8)
    size = np.repeat([0.015, 0.004], 3)
    error = size * rng.standard_t(3, (raw.height, 6))
    if kind == "gross errors":
        error = size / 0.075 * rng.normal(size=(raw.height, 6)) * (rng.random((raw.height, 6)) < 0.01)
    spoilt = raw.with_columns(pl.col(name) + pl.Series(e) for name, e in zip(VELOCITY, error.T, strict=True))
    found = fit(vehicle, spoilt, ["linear_damping", "quadratic_damping"])
    truth = np.concatenate([synthetic.LINEAR, synthetic.QUADRATIC])
    assert np.abs((found.values - truth) / found.standard_errors).max() < 3.0
    assert found.chi2 == pytest.approx(1.0, abs=0.06)
    assert any("heavy tails" in warning for warning in found.warnings)


def test_columns_that_are_not_what_they_are_called_stop_a_fit():
    """In the words of a diagnosis, which goes on with the column put right."""
    raw = noisy(moved(damped(), rows=4000), 0)
    reversed_ = raw.with_columns(-pl.col("v"))
    (told,) = cleaned(damped(), reversed_).faults
    with pytest.raises(DataError, match=r"column v.* when importing the log$") as refused:
        fit(damped(), reversed_, ["linear_damping"], method="equation")
    assert told.message.startswith(str(refused.value))


BLUEROV2 = Path(__file__).resolve().parents[3] / "datasets" / "vehicles" / "bluerov2_heavy.toml"


def test_a_sensor_more_does_not_spoil_a_net_buoyancy():
    """The attitude shows a trim that the file lacks: its moment must not be taken for a weight."""
    known, _ = files.read(BLUEROV2)
    depth, both = (fit(known, sunk(0, attitude=seen), ["net_buoyancy"]) for seen in (False, True))
    error = float(np.hypot(depth.standard_errors[0], both.standard_errors[0]))
    assert both.values[0] == pytest.approx(depth.values[0], abs=3.0 * error)
    assert both.standard_errors[0] <= depth.standard_errors[0]
    assert both.chi2 < 1.5
    assert any("fitted along and not written" in line for line in both.warnings)
    assert [table["name"] for table in both.tables()] == ["net_buoyancy"]
