"""Sessions, demands, and their way to commands."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import DataError
from hydro.core.simulation.excitation import (
    DECKS,
    LONGEST,
    SHORTEST,
    SWEEPS,
    Session,
    _sweep,
    demands,
    holds_heading,
    plan,
)
from hydro.core.vehicle.control_allocation import hold_kernel, mixing, mixing_kernel
from hydro.core.vehicle.description import Buoyancy, Hull, RigidBody, Thruster, Vehicle
from hydro.core.vehicle.frames import rotation
from hydro.core.vehicle.thrusters import configuration_matrix, static_thrust

DT = 0.02


@pytest.mark.parametrize("seed", range(5))
def test_a_sweep_is_slow_and_of_all_frequencies_below_one_hertz(seed):
    """Its power lies where a vehicle answers, and no tenth of a hertz up to 0.3 Hz is left out."""
    wave = _sweep(round(600.0 / DT), DT, np.random.default_rng(seed))
    power, f = np.abs(np.fft.rfft(wave)) ** 2, np.fft.rfftfreq(len(wave), DT)
    assert power[f < 1.0].sum() > 0.98 * power.sum()
    for low in (0.02, 0.1, 0.2):
        assert power[(f >= low) & (f < low + 0.1)].sum() > 0.02 * power.sum()


def vehicle(*thrusters: Thruster) -> Vehicle:
    return Vehicle(
        name="test",
        rigid_body=RigidBody(100.0, (0.0, 0.0, 0.05), ((5.0, 0, 0), (0, 10.0, 0), (0, 0, 12.0))),
        buoyancy=Buoyancy(981.0, (0.0, 0.0, 0.0)),
        hull=Hull(1.5, 0.5, 0.4),
        thruster=thrusters,
    )


def six_axes(**keys: object) -> tuple[Thruster, ...]:
    """One thruster per axis, as axis demands."""
    wrenches = np.eye(6) * [1, 1, 1, 0.5, 0.5, 0.5]
    return tuple(Thruster(f"T{i}", 50.0, 40.0, wrench=tuple(w), **keys) for i, w in enumerate(wrenches))


@given(st.integers(1, 2_000_000), st.integers(0, 1000), st.sampled_from(sorted(DECKS)))
def test_sessions_add_up_to_exactly_the_rows(rows, seed, excitation):
    sessions = plan(rows, seed, excitation=excitation)
    assert sum(session.rows for session in sessions) == rows
    assert len({session.name for session in sessions}) == len(sessions)
    assert {session.kind for session in sessions} <= set(DECKS[excitation])
    if excitation != "replay90" and rows > 200_000:
        assert all(SHORTEST <= session.rows <= LONGEST for session in sessions)


def test_the_papers_collection():
    sessions = plan(857_542, 0)
    assert sum(session.rows for session in sessions) == 857_542
    assert {session.kind for session in sessions} == {*SWEEPS, "coupled", "walk"}
    assert 40 <= len(sessions) <= 70


def test_a_small_collection_shows_most_kinds():
    assert len({session.kind for session in plan(20_000, 3)}) >= 4


def test_axes_that_cannot_be_driven_are_not_swept():
    kinds = {session.kind for session in plan(500_000, 0, axes=(0, 4, 5))}
    assert kinds == {"sweep_surge", "sweep_yaw", "coupled", "walk"}


def test_what_cannot_be_planned():
    with pytest.raises(DataError, match="there are hybrid, sweeps"):
        plan(100, 0, excitation="jumps")
    with pytest.raises(DataError, match="at least one row"):
        plan(0, 0)
    with pytest.raises(DataError, match="thrusters produce no axis"):
        plan(100, 0, axes=())
    with pytest.raises(DataError, match="thrusters produce no axis"):
        plan(100, 0, axes=(3, 4), excitation="sweeps")


@given(
    st.sampled_from([*SWEEPS, "coupled", "walk", "replay90"]),
    st.integers(1, 5000),
    st.integers(0, 50),
    st.integers(0, 2**31),
)
def test_demands_are_shares_and_come_from_seed_and_number_alone(kind, rows, number, seed):
    demand = demands(Session("one", kind, rows, number), seed, DT)
    assert demand.shape == (rows, 6)
    assert np.isfinite(demand).all()
    assert np.abs(demand).max() <= 1.0
    np.testing.assert_array_equal(demand, demands(Session("another", kind, rows, number), seed, DT))


def test_other_seeds_and_numbers_give_other_demands():
    for kind in ("sweep_surge", "coupled", "walk"):
        three = [demands(Session("s", kind, 500, n), seed, DT) for n, seed in ((0, 0), (1, 0), (0, 1))]
        assert not np.array_equal(three[0], three[1])
        assert not np.array_equal(three[0], three[2])


@pytest.mark.parametrize(("kind", "axis"), SWEEPS.items())
def test_a_sweep_moves_one_axis_through_a_band_of_frequencies(kind, axis):
    demand = demands(Session("s", kind, 15_000, 4), 7, DT)
    assert not np.delete(demand, axis, axis=1).any()
    spectrum = np.abs(np.fft.rfft(demand[:, axis])) ** 2
    frequency = np.fft.rfftfreq(15_000, DT)
    share = [spectrum[(frequency >= low) & (frequency < high)].sum() for low, high in ((0, 0.1), (0.1, 1.0))]
    assert min(share) > 0.05 * sum(share)
    assert spectrum[frequency > 1.2].sum() < 1e-3 * spectrum.sum()


def test_a_walk_is_an_ornstein_uhlenbeck_process():
    """Its autocorrelation falls as exp(-lag/T) with one T of 1 to 6 s, or faster where clipped."""
    demand = demands(Session("s", "walk", 400_000, 0), 2, DT)
    for axis in range(6):
        x = demand[:, axis] - demand[:, axis].mean()
        correlation = [x[: -lag or None] @ x[lag:] / (x @ x) for lag in (25, 50)]
        constant = -0.5 / np.log(correlation[0])
        assert 0.8 < constant < 7.0
        assert correlation[1] == pytest.approx(correlation[0] ** 2, abs=0.03)


def test_the_replay_has_nine_segments_that_never_change():
    demand = demands(Session("replay90", "replay90", 4500, 0), 0, DT)
    np.testing.assert_array_equal(demand, demands(Session("replay90", "replay90", 4500, 0), 99, DT))
    used = [
        np.flatnonzero(np.abs(demand[500 * i + 100 : 500 * (i + 1)]).max(axis=0) > 0.05) for i in range(9)
    ]
    assert [list(axes) for axes in used[:3]] == [[0], [2], [5]]
    assert all(len(axes) >= 2 for axes in used[3:])


def test_the_replays_two_drift_turns_are_mirror_images():
    """To port as to starboard: sway and yaw change their signs and surge does not."""
    demand = demands(Session("replay90", "replay90", 4500, 0), 0, DT)
    starboard, port = (demand[500 * i + 400 : 500 * (i + 1)] for i in (6, 7))
    assert np.abs(starboard[:, [0, 1, 5]]).min() > 0.2
    np.testing.assert_allclose(port, starboard * [1, -1, 1, 1, 1, -1], atol=0.01)


def test_single_axis_sweeps_hold_their_heading():
    assert [kind for kind in (*SWEEPS, "coupled", "walk") if holds_heading(kind)] == [
        "sweep_surge",
        "sweep_sway",
        "sweep_heave",
    ]


def test_authority_is_what_the_weaker_direction_gives():
    crew = mixing(vehicle(*six_axes()), np.eye(6))
    assert crew.authority == pytest.approx([40, 40, 40, 20, 20, 20])
    assert crew.axes == (0, 1, 2, 3, 4, 5)


def test_an_axis_without_thrusters_has_no_authority_and_no_hold():
    """Two vertical thrusters fore and aft: heave and pitch, nothing else."""
    pair = [
        Thruster(n, 50.0, 50.0, position=(x, 0, 0), direction=(0, 0, 1)) for n, x in (("a", 0.4), ("b", -0.4))
    ]
    crew = mixing(vehicle(*pair), np.eye(6))
    assert crew.axes == (2, 4)
    assert crew.authority[[2, 4]] == pytest.approx([100, 40])
    assert (crew.gains.sum(axis=1) > 0).tolist() == [True, False, True, False]
    assert mixing(vehicle(), np.eye(6)).axes == ()


@given(
    st.lists(st.floats(-1, 1), min_size=6, max_size=6),
    st.sampled_from(["linear", "quadratic"]),
)
def test_commands_produce_the_wrench_where_nothing_saturates(shares, curve):
    craft = vehicle(*six_axes(curve=curve))
    crew = mixing(craft, np.eye(6))
    tau = np.array(shares) * crew.authority
    commands = np.zeros(6)
    mixing_kernel(crew.allocation, crew.table, tau, commands)
    thrusts = [static_thrust(row, n) for row, n in zip(crew.table, commands, strict=True)]
    np.testing.assert_allclose(configuration_matrix(craft) @ thrusts, tau, atol=1e-5)
    np.testing.assert_array_equal(commands, commands.astype(np.float32).astype(np.float64))


def test_commands_saturate():
    crew = mixing(vehicle(*six_axes()), np.eye(6))
    commands = np.zeros(6)
    mixing_kernel(crew.allocation, crew.table, np.full(6, 1e9) * [1, -1, 1, -1, 1, -1], commands)
    assert commands.tolist() == [1, -1, 1, -1, 1, -1]


def held(crew, eta, nu, depth=0.0, heading=(0.0, 0.0)):
    tau = np.zeros(6)
    R = np.ascontiguousarray(rotation(*eta[3:]).ravel())
    hold_kernel(crew.gains, R, eta[2], np.array(nu, float), depth, np.array(heading), tau)
    return tau


def test_holds_push_back():
    crew = mixing(vehicle(*six_axes()), np.eye(6) * 50.0)
    rest = np.zeros(6)
    assert held(crew, np.zeros(6), rest) == pytest.approx(rest)
    assert held(crew, np.array([0, 0, 2.0, 0, 0, 0]), rest)[2] < 0
    assert held(crew, np.array([0, 0, 0, 0.2, 0, 0]), rest)[3] < 0
    assert held(crew, np.array([0, 0, 0, 0, 0.2, 0]), rest)[4] < 0
    assert held(crew, np.array([0, 0, 0, 0, 0, 0.2]), rest)[5] == 0
    assert held(crew, np.array([0, 0, 0, 0, 0, 0.2]), rest, heading=(1.0, 0.0))[5] < 0
    ahead = np.array([0, 0, 0, 0, 0, 3.0]), rest
    assert held(crew, *ahead, heading=(np.cos(-3.0), np.sin(-3.0)))[5] > 0, "the short way round"
    for axis in range(2, 6):
        nu = np.eye(6)[axis]
        assert held(crew, np.zeros(6), nu, heading=(1.0, 0.0))[axis] < 0


def test_the_depth_hold_pushes_down_in_the_world_at_any_attitude():
    crew = mixing(vehicle(*six_axes()), np.eye(6) * 50.0)
    eta = np.array([0, 0, 3.0, 0.4, -0.6, 1.0])
    force = rotation(*eta[3:]) @ held(crew, eta, np.zeros(6))[:3]
    np.testing.assert_allclose(force, [0, 0, -3.0 * crew.gains[0, 0]], atol=1e-12)


def test_holds_are_slower_than_their_thrusters():
    slow = six_axes(time_constant=0.5)
    crew = mixing(vehicle(*slow), np.eye(6) * 50.0)
    frequency = np.sqrt(crew.gains[1:, 0] / 50.0)
    assert (frequency * 0.5 <= 0.6 + 1e-9).all()


def test_righting_is_hold_and_restoring_together():
    craft = msgspec.structs.replace(vehicle(*six_axes()), thruster=())
    assert mixing(craft, np.eye(6)).righting == pytest.approx([100 * 9.81 * 0.05] * 2)
