"""The thruster chain against scipy's discretisation, closed-form step responses and a plain loop."""

from __future__ import annotations

import tomllib

import msgspec
import numpy as np
import polars as pl
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete
from strategies import commands, numbers, vectors, vehicles, velocities
from strategies import thrusters as any_thrusters

from hydro.core.errors import DataError
from hydro.core.vehicle import rigid_body, thrusters
from hydro.core.vehicle.description import Buoyancy, Hull, RigidBody, Thruster, Vehicle

DT = 0.02
BODY = RigidBody(100.0, (0.0, 0.0, 0.0), ((5.0, 0.0, 0.0), (0.0, 9.0, 0.0), (0.0, 0.0, 9.0)))


def vehicle_with(*thruster: Thruster) -> Vehicle:
    return Vehicle("case", BODY, Buoyancy(981.0, (0.0, 0.0, 0.0)), Hull(1.0, 1.0, 1.0), thruster=thruster)


def thruster(**fields) -> Thruster:
    surge = {"position": (0.0, 0.0, 0.0), "direction": (1.0, 0.0, 0.0)}
    return Thruster(**({"name": "T1", "max_thrust": 100.0, "max_reverse_thrust": 60.0} | surge | fields))


def row_of(one: Thruster):
    return thrusters.thruster_table(vehicle_with(one))[0]


def settled_thrust(one: Thruster, n):
    """Dead band and curve of the vehicle file's definition, on arrays."""
    power = 2 if one.curve == "quadratic" else 1
    size = np.abs(n) ** power
    if one.deadband_style == "shift":
        size = (size - one.deadband**power) / (1 - one.deadband**power)
    size = np.where(np.abs(n) > one.deadband, size, 0.0)
    return np.where(n > 0, size * one.max_thrust, -size * one.max_reverse_thrust)


def thrusts(vehicle: Vehicle, *arguments, **options):
    """Thrusts of a vehicle file's thrusters, without actuator effects."""
    return thrusters.thrusts(thrusters.thruster_table(vehicle), *arguments, **options)


def states_at(vehicle: Vehicle, held, moments, **options):
    return thrusters.lag_states(
        thrusters.thruster_table(vehicle), held, np.arange(len(held)) * DT, moments, **options
    )


def step_responses(one: Thruster, held, t, moments):
    """Lag state at any moments, from rest, as the sum of one exponential per change of command."""
    target = np.clip(held, -1, 1) if one.lag == "speed" else settled_thrust(one, np.clip(held, -1, 1))
    constant, h = one.time_constant, one.lag_step
    if h:
        constant = -h / np.log(1 - h / constant)
    since = moments[:, None] - (t + one.delay)[None, :]
    felt = since > 1e-12
    left = np.exp(-np.where(felt, since, 0.0) / constant) if constant else np.zeros_like(since)
    return np.where(felt, 1.0 - left, 0.0) @ np.diff(target, prepend=0.0)


def one_segment(rows: int):
    return np.array([[0, rows]])


def configurations(least: int, most: int):
    """Matrices B of so many thrusters."""
    return st.integers(least, most).flatmap(
        lambda count: arrays(np.float64, (6, count), elements=numbers(-1.0, 1.0), fill=st.nothing())
    )


# -- B and its pseudo-inverse ------------------------------------------------------------------------------


def test_configuration_matrix_is_direction_and_lever_arm_cross_direction():
    placed = thruster(position=(0.5, 0.2, -0.1), direction=(0.0, 0.6, 0.8))
    demand = thruster(position=None, direction=None, wrench=(0.0, 0.0, 2.0, 0.0, 0.0, 1.0))
    B = thrusters.configuration_matrix(vehicle_with(placed, demand))
    np.testing.assert_allclose(
        B[:, 0], [0, 0.6, 0.8, 0.2 * 0.8 + 0.1 * 0.6, -0.5 * 0.8, 0.5 * 0.6], atol=1e-15
    )
    np.testing.assert_array_equal(B[:, 1], demand.wrench)
    assert thrusters.configuration_matrix(vehicle_with()).shape == (6, 0)


@pytest.mark.parametrize(
    "fields",
    [
        {"position": None},
        {"direction": None},
        {"position": None, "direction": None},
        {"wrench": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)},
        {"direction": None, "wrench": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)},
    ],
)
def test_a_thruster_placed_nowhere_or_twice_is_refused_by_name(fields):
    vehicle = vehicle_with(thruster(name="bow", **fields))
    for function in (thrusters.configuration_matrix, thrusters.thruster_table):
        with pytest.raises(DataError, match="thruster bow: give either position and direction, or wrench"):
            function(vehicle)


@given(st.data(), vehicles())
def test_the_wrench_is_linear_in_thrust_and_the_sum_over_any_thrusters(data, vehicle):
    count = len(vehicle.thruster)
    B = thrusters.configuration_matrix(vehicle)
    f, g = data.draw(vectors(count, 100.0)), data.draw(vectors(count, 100.0))
    np.testing.assert_allclose(B @ (2.0 * f - g), 2.0 * (B @ f) - B @ g, atol=1e-9)
    by_hand = np.zeros(6)
    for newtons, one in zip(f, vehicle.thruster, strict=True):
        force = newtons * np.array(one.direction)
        by_hand += [*force, *np.cross(one.position, force)]
    np.testing.assert_allclose(B @ f, by_hand, atol=1e-9)


@given(configurations(6, 9), vectors(6, 50.0))
def test_allocation_meets_every_demand_that_the_thrusters_can_meet(B, demand):
    assume(np.linalg.svd(B, compute_uv=False)[-1] > 1e-2)
    f = thrusters.allocate(B, demand)
    np.testing.assert_allclose(B @ f, demand, atol=1e-8)
    np.testing.assert_allclose(thrusters.allocate(B, [demand, 2.0 * demand]), [f, 2.0 * f], atol=1e-8)


@given(configurations(1, 9), vectors(9, 50.0))
def test_allocation_gives_back_the_wrench_with_the_least_thrust(B, thrust):
    assume(np.linalg.svd(B, compute_uv=False)[-1] > 1e-2)
    thrust = thrust[: B.shape[1]]
    f = thrusters.allocate(B, B @ thrust)
    np.testing.assert_allclose(B @ f, B @ thrust, atol=1e-8)
    assert np.linalg.norm(f) <= np.linalg.norm(thrust) + 1e-9


# -- Dead band and curve -----------------------------------------------------------------------------------


@given(any_thrusters(), numbers(-1.0, 1.0))
def test_static_thrust_is_dead_band_then_curve(one, n):
    assert thrusters.static_thrust(row_of(one), n) == pytest.approx(
        settled_thrust(one, n), rel=1e-12, abs=1e-12
    )


@given(any_thrusters(max_thrust=50.0, max_reverse_thrust=50.0), numbers(-1.0, 1.0), numbers(-1.0, 1.0))
def test_static_thrust_is_odd_and_never_falls_with_the_command(one, n, other):
    row = row_of(one)
    assert thrusters.static_thrust(row, -n) == -thrusters.static_thrust(row, n)
    low, high = sorted([n, other])
    assert thrusters.static_thrust(row, low) <= thrusters.static_thrust(row, high)


@given(any_thrusters())
def test_full_commands_give_the_limits_and_the_dead_band_nothing(one):
    row = row_of(one)
    assert thrusters.static_thrust(row, 1.0) == pytest.approx(one.max_thrust, rel=1e-12)
    assert thrusters.static_thrust(row, -1.0) == pytest.approx(-one.max_reverse_thrust, rel=1e-12)
    for n in (0.0, one.deadband, -one.deadband):
        assert thrusters.static_thrust(row, n) == 0.0


@pytest.mark.parametrize("curve", ["linear", "quadratic"])
def test_shift_is_continuous_at_the_dead_band_and_cut_jumps(curve):
    for style, jump in (("shift", 0.0), ("cut", 100.0 * (0.2 if curve == "linear" else 0.04))):
        row = row_of(thruster(curve=curve, deadband=0.2, deadband_style=style))
        assert thrusters.static_thrust(row, 0.2 + 1e-12) == pytest.approx(jump, abs=1e-8)
        assert thrusters.static_thrust(row, -0.2 - 1e-12) == pytest.approx(-0.6 * jump, abs=1e-8)


@given(any_thrusters(), numbers(1.0, 50.0))
def test_commands_beyond_one_are_clipped_first(one, command):
    row = row_of(one)
    assert thrusters.settled_state(row, command) == thrusters.settled_state(row, 1.0)
    assert thrusters.settled_state(row, -command) == thrusters.settled_state(row, -1.0)


# -- The lag -----------------------------------------------------------------------------------------------


@given(any_thrusters(lag="thrust", lag_step=None, time_constant=0.15, delay=0.0), commands(20, 1, 1.5))
def test_the_lag_on_thrust_is_scipys_discretisation(one, held):
    Ad, Bd, *_ = cont2discrete(
        (np.array([[-1 / 0.15]]), np.array([[1 / 0.15]]), np.eye(1), np.zeros((1, 1))), DT
    )
    f = [0.0]
    for target in settled_thrust(one, np.clip(held[:-1, 0], -1, 1)):
        f.append(Ad[0, 0] * f[-1] + Bd[0, 0] * target)
    found = thrusts(vehicle_with(one), held, np.arange(20) * DT, one_segment(20))
    np.testing.assert_allclose(found[:, 0], f, rtol=1e-11, atol=1e-10)


@given(any_thrusters(lag="speed", lag_step=None, time_constant=0.3, delay=0.0), commands(20, 1, 1.5))
def test_the_lag_on_speed_comes_before_dead_band_and_curve(one, held):
    Ad, Bd, *_ = cont2discrete(
        (np.array([[-1 / 0.3]]), np.array([[1 / 0.3]]), np.eye(1), np.zeros((1, 1))), DT
    )
    n = [0.0]
    for command in np.clip(held[:-1, 0], -1, 1):
        n.append(Ad[0, 0] * n[-1] + Bd[0, 0] * command)
    assume(np.all(np.abs(np.abs(n) - one.deadband) > 1e-9))  # at a cut, rounding decides
    found = thrusts(vehicle_with(one), held, np.arange(20) * DT, one_segment(20))
    np.testing.assert_allclose(found[:, 0], settled_thrust(one, np.array(n)), rtol=1e-9, atol=1e-9)


@given(
    any_thrusters(lag="thrust", time_constant=0.1, lag_step=0.002, delay=0.0),
    commands(12, 1),
)
def test_the_euler_lag_is_the_sources_own_loop(one, held):
    f, at_rows = 0.0, []
    for target in settled_thrust(one, held[:, 0]):
        at_rows.append(f)
        for _ in range(10):
            f += 0.002 / 0.1 * (target - f)
    found = thrusts(vehicle_with(one), held, np.arange(12) * DT, one_segment(12))
    np.testing.assert_allclose(found[:, 0], at_rows, rtol=1e-11, atol=1e-10)


def test_an_euler_step_as_long_as_the_time_constant_settles_at_once_and_a_longer_one_is_refused():
    row = row_of(thruster(time_constant=0.02, lag_step=0.02))
    assert thrusters.advance_state(row, 5.0, 1.0, 0.02) == 100.0
    with pytest.raises(DataError, match=r"thruster T1: lag_step 0.05 s exceeds time_constant 0.02 s"):
        row_of(thruster(time_constant=0.02, lag_step=0.05))


@given(any_thrusters(), numbers(-100.0, 100.0), numbers(-1.0, 1.0), numbers(0.0, 0.1), numbers(0.0, 0.1))
def test_advancing_twice_is_advancing_over_the_sum(one, state, command, first, second):
    row = row_of(one)
    once = thrusters.advance_state(row, state, command, first + second)
    twice = thrusters.advance_state(row, thrusters.advance_state(row, state, command, first), command, second)
    assert twice == pytest.approx(once, rel=1e-11, abs=1e-10)


@given(any_thrusters(), numbers(-1.0, 1.0), numbers(-1.0, 1.0), numbers(0.0, 0.2))
def test_the_derivative_integrates_to_the_exact_advance(one, state, command, dt):
    row = row_of(one)
    start = thrusters.advance_state(row, state, command, 0.0)
    end = solve_ivp(
        lambda _, y: [thrusters.state_derivative(row, y[0], command)],
        (0.0, dt),
        [start],
        rtol=1e-9,
        atol=1e-9,
    ).y[0, -1]
    assert end == pytest.approx(thrusters.advance_state(row, state, command, dt), rel=1e-6, abs=1e-6)


def test_without_lag_the_state_follows_at_once():
    row = row_of(thruster())
    assert thrusters.advance_state(row, 3.0, 0.5, 0.0) == 50.0
    assert thrusters.state_derivative(row, 3.0, 0.5) == 0.0


# -- From state to thrust ----------------------------------------------------------------------------------


@given(any_thrusters(lag="thrust"), numbers(-100.0, 100.0), velocities())
def test_gain_then_asymmetry_then_inflow(one, state, nu_r):
    row = row_of(one)
    assert thrusters.state_to_thrust(row, state, 1.0) == state
    row[[thrusters.GAIN, thrusters.ASYMMETRY, thrusters.INFLOW]] = [-0.4, 0.1, 0.05]
    axial = np.dot(one.direction, nu_r[:3] + np.cross(nu_r[3:], one.position))
    assert thrusters.inflow_speed(row, nu_r) == pytest.approx(axial, abs=1e-12)
    f = 0.6 * state * (0.9 if state < 0 else 1.0)
    expected = f - 0.05 * np.sqrt(abs(f) * one.max_thrust) * axial
    assert thrusters.state_to_thrust(row, state, axial) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_columns_apply_the_effects_of_the_table_and_the_water():
    vehicle = vehicle_with(thruster(), thruster(name="T2", lag="speed", curve="quadratic"))
    table = thrusters.thruster_table(vehicle)
    table[:, thrusters.GAIN], table[:, thrusters.INFLOW] = [0.5, 0.0], 0.01
    nu_r = np.zeros((3, 6))
    nu_r[:, 0] = 2.0
    f = thrusters.thrusts(table, np.full((3, 2), 0.5), np.arange(3) * DT, one_segment(3), nu_r=nu_r)
    ahead = np.array([75.0, 25.0])
    np.testing.assert_allclose(
        f, [[0.0, 0.0], *[ahead - 0.01 * np.sqrt(ahead * 100.0) * 2.0] * 2], rtol=1e-12
    )


# -- Columns: what is felt when ----------------------------------------------------------------------------


@given(any_thrusters(), commands(15, 1), numbers(0.0, 1.0))
def test_any_lag_state_sums_its_step_responses_even_on_a_jittery_clock(one, held, jitter):
    t = 3.0 + DT * (np.arange(15) + 0.01 * jitter * np.sin(7.0 * np.arange(15)))
    nearest = np.abs(t[:, None] - t[None, :] - one.delay)
    assume(not np.any((nearest > 1e-13) & (nearest < 1e-9)))  # neither at once nor apart
    table = thrusters.thruster_table(vehicle_with(one))
    found = thrusters.lag_states(table, held, t, t)[:, 0]
    np.testing.assert_allclose(found, step_responses(one, held[:, 0], t, t), rtol=1e-7, atol=1e-7)
    thrust = thrusts(vehicle_with(one), held, t, one_segment(15))[:, 0]
    expected = [thrusters.state_to_thrust(table[0], state, 0.0) for state in found]
    np.testing.assert_array_equal(thrust, expected)


@given(vehicles(max_thrusters=3), st.data())
def test_a_command_is_felt_from_the_next_row_on_and_never_before(vehicle, data):
    count = len(vehicle.thruster)
    held, changed = data.draw(commands(10, count)), data.draw(commands(10, count))
    k = data.draw(st.integers(0, 9))
    t = np.arange(10) * DT
    changed[:k] = held[:k]
    before = thrusts(vehicle, held, t, one_segment(10))
    after = thrusts(vehicle, changed, t, one_segment(10))
    np.testing.assert_array_equal(before[0], 0.0)
    np.testing.assert_array_equal(before[: k + 1], after[: k + 1])


def test_the_first_command_is_felt_at_the_second_row():
    f = thrusts(vehicle_with(thruster()), [[1.0], [0.5], [0.0]], np.arange(3) * DT, one_segment(3))
    np.testing.assert_array_equal(f[:, 0], [0.0, 100.0, 50.0])


@pytest.mark.parametrize("start", [0.0, 0.1, 1234.56, 1.7e9])
@pytest.mark.parametrize("rows", [1, 3])
def test_a_delay_of_whole_rows_shifts_the_thrust_by_as_many_rows(start, rows):
    t = start + np.arange(40) * DT
    held = np.sin(np.arange(40.0))[:, None]
    prompt = thrusts(vehicle_with(thruster()), held, t, one_segment(40))
    late = thrusts(vehicle_with(thruster(delay=rows * DT)), held, t, one_segment(40))
    np.testing.assert_array_equal(late[:rows], 0.0)
    np.testing.assert_array_equal(late[rows:], prompt[:-rows])


def test_a_delay_of_part_of_a_row_splits_the_row():
    one = thruster(time_constant=0.1, delay=0.015)
    f = thrusts(vehicle_with(one), [[1.0], [-1.0], [0.0]], np.arange(3) * DT, one_segment(3))[:, 0]
    after_first = 100.0 * (1 - np.exp(-0.005 / 0.1))
    middle = 100.0 + (after_first - 100.0) * np.exp(-0.015 / 0.1)
    after_second = -60.0 + (middle + 60.0) * np.exp(-0.005 / 0.1)
    np.testing.assert_allclose(f, [0.0, after_first, after_second], rtol=1e-12)


@given(vehicles(max_thrusters=3), st.data())
def test_each_segment_stands_alone_and_resumes_settled_after_a_gap(vehicle, data):
    count = len(vehicle.thruster)
    held = data.draw(commands(12, count))
    t = np.concatenate([np.arange(5), np.arange(7) + 100.0]) * DT
    both = thrusts(vehicle, held, t, [[0, 5], [5, 12]])
    np.testing.assert_array_equal(both[5:], thrusts(vehicle, held[5:], t[5:], one_segment(7)))
    resumed = thrusts(vehicle, held, t, [[0, 5], [5, 12]], after_gap=[False, True])
    np.testing.assert_array_equal(resumed[:5], both[:5])
    settled = [float(settled_thrust(one, c)) for one, c in zip(vehicle.thruster, held[5], strict=True)]
    np.testing.assert_allclose(resumed[5], settled, rtol=1e-12, atol=1e-12)


def test_a_constant_command_after_a_gap_stays_settled_whatever_the_delay():
    one = thruster(time_constant=0.2, delay=0.03)
    f = thrusts(vehicle_with(one), np.full((9, 1), 0.4), np.arange(9) * DT, one_segment(9), after_gap=[1])
    np.testing.assert_allclose(f, 40.0, rtol=1e-12)


@given(vehicles(max_thrusters=3), st.data(), st.integers(1, 12))
def test_states_at_the_rows_are_the_same_however_often_one_looks_in_between(vehicle, data, substeps):
    held = data.draw(commands(6, len(vehicle.thruster)))
    rows = states_at(vehicle, held, np.arange(6) * DT)
    often = states_at(vehicle, held, np.arange(6 * substeps) * (DT / substeps))
    np.testing.assert_allclose(often[::substeps], rows, rtol=1e-9, atol=1e-8)


def test_states_between_the_rows_are_the_step_responses():
    one = thruster(time_constant=0.1, delay=0.013)
    held = np.array([1.0, -0.5, 0.2])
    middles = (np.arange(30) + 0.5) * DT / 10
    found = states_at(vehicle_with(one), held[:, None], middles)
    np.testing.assert_allclose(found[:, 0], step_responses(one, held, np.arange(3) * DT, middles), rtol=1e-11)
    prompt = states_at(vehicle_with(thruster()), held[:, None], middles)
    np.testing.assert_array_equal(prompt[:, 0], np.repeat([100.0, -30.0, 20.0], 10))


def test_single_precision_and_strided_columns_are_accepted():
    vehicle = vehicle_with(thruster(time_constant=0.1), thruster(name="T2", delay=0.01))
    held = np.random.default_rng(0).uniform(-1, 1, (50, 2)).astype(np.float32)
    t = np.arange(50) * DT
    expected = thrusts(vehicle, held.astype(float), t, one_segment(50))
    np.testing.assert_array_equal(thrusts(vehicle, np.asfortranarray(held), t, one_segment(50)), expected)


@pytest.mark.parametrize("shape", [(5, 2), (4, 1), (5,), (0, 1)])
def test_commands_that_do_not_fit_are_refused(shape):
    with pytest.raises(DataError, match="commands: expected 5 rows of 1 thrusters, got shape"):
        thrusts(vehicle_with(thruster()), np.zeros(shape), np.arange(5) * DT, one_segment(5))


def test_nothing_in_nothing_out():
    vehicle = vehicle_with(thruster())
    assert thrusts(vehicle, np.zeros((0, 1)), np.zeros(0), np.zeros((0, 2))).shape == (0, 1)
    assert thrusts(vehicle_with(), np.zeros((4, 0)), np.arange(4.0), one_segment(4)).shape == (
        4,
        0,
    )
    assert states_at(vehicle, np.zeros((0, 1)), np.zeros(0)).shape == (0, 1)


# -- Stonefish ---------------------------------------------------------------------------------------------

ROTOR = {
    "max_thrust": 155.0,
    "max_reverse_thrust": 155.0,
    "curve": "quadratic",
    "lag": "speed",
    "time_constant": 0.15,
    "lag_step": 0.002,
    "deadband": 0.05,
    "deadband_style": "shift",
}


def test_thrust_of_the_recorded_replay_is_the_simulators_own_formula(datasets):
    """T = 155 sgn(n) (n^2 - 0.05^2) / (1 - 0.05^2), with n by forward Euler at 500 Hz."""
    log = pl.read_parquet(
        datasets / "stonefish" / "replay90.parquet", columns=["t", *(f"cmd_{i}" for i in range(1, 9))]
    )
    held, t = log.drop("t").to_numpy().astype(float), log["t"].to_numpy()
    n, speeds = np.zeros(8), []
    for row in held:
        speeds.append(n)
        for _ in range(10):
            n = n + 0.002 / 0.15 * (np.clip(row, -1, 1) - n)
    n = np.array(speeds)
    expected = np.where(np.abs(n) > 0.05, 155.0 * np.sign(n) * (n**2 - 0.05**2) / (1 - 0.05**2), 0.0)
    vehicle = vehicle_with(*(thruster(name=f"T{i}", **ROTOR) for i in range(1, 9)))
    found = thrusts(vehicle, held, t, one_segment(len(t)))
    assert np.abs(found).max() > 50.0
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_thrust_moves_the_recorded_vehicle_from_rest_when_and_where_it_did(stonefish):
    """Momentum after three rows is the impulse of thrust, weight and buoyancy: at 2 mm/s without drag."""
    content = tomllib.loads((stonefish / "vehicle.toml").read_text())
    for entry in content["thruster"]:
        entry["lag_step"] = 0.002
    vehicle = msgspec.convert(content, Vehicle)
    inertia = rigid_body.mass_matrix(vehicle) + np.array(vehicle.effects("added_mass")[0]["matrix"])
    log = pl.scan_parquet(stonefish / "nominal.parquet")
    B = thrusters.configuration_matrix(vehicle)
    for session, axis in (("nom_050_sweep_heave", 2), ("nom_049_coupled", 0), ("nom_014_ou", 0)):
        start = log.filter(pl.col("session") == session).head(4).collect().cast({"t": pl.Float64})
        held = start.select(pl.selectors.starts_with("cmd_")).to_numpy()
        momentum = inertia @ start.select("u", "v", "w", "p", "q", "r").to_numpy()[3]
        ends = np.arange(1, 31) * 0.002  # Stonefish moves its rotors before the body in each step
        speeds = states_at(vehicle, held[:3], ends)
        impulse = sum(B @ settled_thrust(vehicle.thruster[0], n) for n in speeds) * 0.002
        impulse += 3 * DT * rigid_body.restoring(vehicle, start["phi"][0], start["theta"][0])
        assert momentum[axis] == pytest.approx(impulse[axis], rel=0.01)
