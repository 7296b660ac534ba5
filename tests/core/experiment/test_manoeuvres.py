"""Manoeuvres that any vehicle can fly, and predictions of what they show against closed forms."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import damped

from hydro.core.columns import POSE, VELOCITY
from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.experiment.library import FASTEST, FLIGHT_LENGTH, _multisines, _stiffness, library
from hydro.core.experiment.manoeuvres import best, plain, showing
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.simulation.excitation import LOG_RATE
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Buoyancy, Hull, RigidBody, Thruster, Vehicle
from hydro.io import vehicle as files

NOISE = np.repeat([0.02, 0.001, 0.01, 0.002], 3)


def bar(*effects: dict) -> Vehicle:
    """A weightless bar with one thruster along it: whatever happens, it moves straight ahead."""
    return Vehicle(
        name="bar",
        rigid_body=RigidBody(50.0, (0.0, 0.0, 0.0), ((5.0, 0, 0), (0, 5.0, 0), (0, 0, 5.0))),
        buoyancy=Buoyancy(50.0 * 9.81, (0.0, 0.0, 0.0)),
        hull=Hull(1.0, 0.3, 0.3),
        thruster=(Thruster("T", 20.0, 20.0, wrench=(1.0, 0, 0, 0, 0, 0)),),
        effect=({"name": "linear_damping", "diagonal": [20.0] * 3 + [5.0] * 3}, *effects),
    )


def hiding(vehicle: Vehicle, *effects: dict) -> Vehicle:
    return msgspec.structs.replace(vehicle, effect=(*vehicle.effect, *effects))


@pytest.mark.parametrize("name", ["auv151", "bluerov2_heavy", "remus100", "stonefish"])
def test_every_vehicle_can_fly_its_library(datasets, name):
    vehicle = files.read(datasets / "vehicles" / f"{name}.toml")[0]
    flown = library(vehicle)
    assert len({one.name for one in flown}) == len(flown) >= 5
    for one in flown:
        assert one.commands.shape == (round(FLIGHT_LENGTH * 50.0), len(vehicle.thruster))
        assert 0.01 < np.abs(one.commands).max() <= 1.0
    table = flown[0].table()
    moved = simulate(vehicle, table)
    assert moved.height == table.height
    assert moved.select(table.columns).equals(table)


def test_what_the_thrusters_cannot_do_is_not_asked_for():
    names = {one.name for one in library(bar())}
    assert names == {
        "full speed in surge",
        "surge levels",
        "surge step and coast",
        "surge chirp",
        "single thrusters",
    }
    with pytest.raises(DataError, match="no thrusters"):
        library(msgspec.structs.replace(bar(), thruster=()))


def test_a_slow_turn_goes_once_around():
    vehicle = damped()
    (sweep,) = (one for one in library(vehicle) if one.name == "heading sweep")
    heading = np.unwrap(simulate(vehicle, sweep.table())["psi"].to_numpy())
    assert 4.0 < np.ptp(heading) < 20.0


def test_only_what_rights_itself_is_held_at_a_tilt_against_its_righting_moment():
    vehicle = synthetic.vehicle()
    arm = synthetic.MASS * synthetic.GRAVITY * synthetic.WEIGHT_ARM[2]
    righting = arm - synthetic.BUOYANCY * synthetic.BUOYANCY_ARM[2]
    assert righting > 0.0
    assert _stiffness(vehicle) == pytest.approx(righting)
    top = msgspec.structs.replace(vehicle, buoyancy=Buoyancy(synthetic.BUOYANCY, (0.0, 0.0, 0.5)))
    assert _stiffness(top) == 0.0


def test_a_slow_turn_against_strong_damping_goes_once_around_in_its_time():
    vehicle = hiding(synthetic.vehicle(), {"name": "linear_damping", "diagonal": [2000.0] * 3 + [60.0] * 3})
    (sweep,) = (one for one in library(vehicle, 20.0) if one.name == "heading sweep")
    rate = simulate(vehicle, sweep.table())["r"].to_numpy()[-1]
    assert abs(rate) == pytest.approx(2.0 * np.pi / 20.0, rel=0.05)


def test_tilts_are_near_fifteen_degrees():
    vehicle = damped()
    (tilts,) = (one for one in library(vehicle) if one.name == "static tilts")
    moved = simulate(vehicle, tilts.table())
    quarters = moved.select("phi", "theta").to_numpy().reshape(4, -1, 2)[:, 50:].mean(axis=1)
    swings = 0.5 * np.rad2deg([quarters[0, 0] - quarters[1, 0], quarters[2, 1] - quarters[3, 1]])
    np.testing.assert_allclose(swings, 15.0, atol=4.0)


def test_a_bias_of_the_log_differs_by_what_least_squares_says():
    """Each shot of 100 rows is free to begin elsewhere and faster: what is left of the bias then is known."""
    b, dt, count = 0.05, 0.02, 100
    t, decay = np.arange(count) * dt, 20.0 / 50.0
    travel = (1.0 - np.exp(-decay * t)) / decay
    columns = np.block(
        [[np.ones((count, 1)), travel[:, None]], [np.zeros((count, 1)), np.exp(-decay * t)[:, None]]]
    )
    seen = np.r_[np.zeros(count), np.full(count, b)]
    weights = np.r_[np.full(count, 1.0 / 0.02), np.full(count, 1.0 / 0.01)][:, None]
    trust = np.diag([1.0 / 0.1, 1.0 / 0.3])
    Z, e = np.vstack([columns * weights, trust]), np.r_[seen * weights[:, 0], 0.0, 0.0]
    left = e - Z @ np.linalg.lstsq(Z, e)[0]
    expected = np.sqrt(15 * float(left @ left))
    rivals = {"bias": bar({"name": "sensor_bias", "b": [b, 0.0, 0.0]})}
    assert showing(bar(), rivals, NOISE)["bias"].difference == pytest.approx(expected, rel=1e-3)


def test_the_difference_counts_in_units_of_the_noise_and_is_that_of_the_closest_pair():
    lag, delay = bar({"name": "thruster_lag", "dT": 0.1}), bar({"name": "command_delay", "d": 0.1})
    apart = best([lag, delay], NOISE)
    assert apart.difference > 1.0
    assert best([lag, delay], 2.0 * NOISE).difference < 0.6 * apart.difference
    assert best([lag, lag], NOISE).difference == pytest.approx(0.0, abs=1e-6)
    assert best([lag, delay, delay], NOISE).difference == pytest.approx(0.0, abs=1e-6)
    assert best([lag, delay, bar()], NOISE).difference <= apart.difference + 1e-9


def test_a_third_rival_without_the_delay_of_two_changes_nothing_between_them():
    early, late = (bar({"name": "sensor_delay", "d": d}) for d in (0.1, 0.14))
    far = bar({"name": "sensor_bias", "b": [0.5, 0.0, 0.0]})
    apart = best([early, late], NOISE).difference
    assert apart > 0.1
    assert best([early, late, far], NOISE).difference == pytest.approx(apart, rel=1e-9)


def test_what_grows_with_frequency_is_told_by_a_chirp_and_not_by_a_slow_turn():
    vehicle = damped()
    rivals = [
        hiding(vehicle, {"name": n, k: 0.03}) for n, k in (("thruster_lag", "dT"), ("command_delay", "d"))
    ]
    flight = best([*rivals, hiding(vehicle, {"name": "sensor_delay", "d": 0.03})], NOISE)
    assert flight.difference > 10.0
    assert "chirp" in flight.manoeuvre.name or flight.manoeuvre.name == "single thrusters"


def test_what_would_show_an_effect_of_plain_size():
    vehicle = damped()
    changed = {name: plain(vehicle, name) for name in ("thruster_gain", "body_lift", "net_buoyancy")}
    found = showing(vehicle, changed, NOISE)
    assert set(found) == set(changed)
    assert all(flight.difference > 10.0 for flight in found.values())
    last = plain(vehicle, "thruster_gain", [7])
    assert last.effects("thruster_gain")[0]["g"] == [0.0] * 7 + [pytest.approx(0.3)]


@pytest.mark.parametrize(
    "name", [name for name, effect in CATALOGUE.items() if not (effect.is_written or effect.is_random)]
)
def test_every_effect_has_a_plain_size(name):
    vehicle = damped()
    assert plain(vehicle, name).effects(name) != vehicle.effects(name)


def test_too_few_rivals_and_motions_without_bounds():
    with pytest.raises(DataError, match="at least two vehicles"):
        best([bar()], NOISE)
    pushed = bar({"name": "sensor_bias", "b": [0.1, 0, 0]})
    runaway = msgspec.structs.replace(
        bar(), effect=({"name": "linear_damping", "diagonal": [-2000.0] + [5.0] * 5},)
    )
    with pytest.raises(DataError, match="diverges"):
        best([runaway, pushed], NOISE)


def test_what_is_predicted_is_what_a_flight_shows():
    """One rival is true: flown with noise, the other errs by the difference more."""
    true, other = (hiding(damped(), {"name": "thruster_lag", "dT": t}) for t in (0.02, 0.035))
    flight = best([true, other], NOISE)
    flown = simulate(true, flight.manoeuvre.table())
    logged = disturb(
        flown.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], np.random.default_rng(3)
    )
    record = recording(true, flown.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY])))
    costs = []
    for rival in (true, other):
        shots = make_shots(record, sigma=NOISE)
        problem = OutputError.of(shots, rival)
        for _ in range(3):
            normal = problem.linearise(rival, [], [])
            _, problem = problem.cost(rival, np.zeros(0), normal)
        costs.append(normal.cost)
    assert flight.difference > 20.0
    assert np.sqrt(costs[1] - costs[0]) == pytest.approx(flight.difference, rel=0.15)


def test_sines_on_all_axes_share_no_frequency_and_stay_within_their_size(datasets):
    """Orthogonal multisines (Morelli 2012): products of two axes over whole periods are nothing."""
    rows, axes = 1500, [0, 1, 2, 5]
    demand = _multisines(rows, axes)
    np.testing.assert_allclose(np.abs(demand[:, axes]).max(axis=0), 1.0)
    assert not demand[:, [3, 4]].any(), "axes that the vehicle has not"
    products = demand.T @ demand / rows
    np.testing.assert_allclose(products - np.diag(np.diag(products)), 0.0, atol=1e-12)
    power = np.abs(np.fft.rfft(demand, axis=0)) ** 2
    frequency = np.fft.rfftfreq(rows, 1.0 / LOG_RATE)
    assert power[frequency > FASTEST + 1e-9].max() < 1e-9 * power.max()
    assert (demand[:, axes] ** 2).mean(axis=0).min() > 0.1, "peaks are low for what is in them"


def test_a_vehicle_of_one_axis_has_no_flight_on_all_axes():
    assert "all axes" not in {one.name for one in library(bar(), by_hand=False)}


def test_what_no_pilot_flies_by_hand_is_for_flights_from_a_table(datasets):
    vehicle = files.read(datasets / "vehicles" / "auv151.toml")[0]
    by_hand, every = ({one.name for one in library(vehicle, by_hand=hand)} for hand in (True, False))
    assert every - by_hand == {"all axes"}
