"""Forward simulation against scipy's integrator on equations written anew, and against closed forms."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from scipy.integrate import solve_ivp
from strategies import numbers, states

from hydro.core.columns import POSE, VELOCITY
from hydro.core.effects import assemble
from hydro.core.errors import DataError
from hydro.core.simulation.simulate import simulate, trajectory
from hydro.core.vehicle.description import Buoyancy, Hull, RigidBody, Thruster, Vehicle
from hydro.core.vehicle.frames import rotation

ADDED = np.array([[12.0, 0, 0, 0, 2, 0], [0, 50, 0, -1, 0, 3], [0, 0, 65, 0, -2, 0],
                  [0, -1, 0, 1.5, 0, 0], [2, 0, -2, 0, 9, 0], [0, 3, 0, 0, 0, 8.0]])  # fmt: skip
LINEAR = np.array([5.0, 20.0, 30.0, 2.0, 6.0, 5.0])
QUADRATIC = np.array([40.0, 150.0, 200.0, 4.0, 20.0, 18.0])
CURRENT = np.array([0.35, -0.2, 0.05])
CG, CB = np.array([0.02, -0.01, 0.04]), np.array([0.03, -0.02, -0.08])
INERTIA = np.array([[1.5, 0.1, -0.05], [0.1, 5.0, 0.2], [-0.05, 0.2, 5.5]])
MASS, BUOYANCY, G = 50.0, 505.0, 9.81
LOAD, LOAD_AT, LOAD_MASS = 6.0, np.array([0.3, 0.1, 0.2]), 4.0
MEMORY, RATE = np.array([6.0, 8.0, 9.0, 1.0, 2.0, 3.0]), 2.5
TETHER, SLACK, ANCHOR, ATTACHED = 8.0, 1.0, np.array([2.0, -1.0, 3.0]), np.array([0.5, 0.0, -0.1])
B = np.array([[1.0, 0, 0, 0, 0, -0.1], [0.0, 1, 0, -0.05, 0, 0.3]]).T
LAG, DELAY, LIMITS = 0.2, 0.033, (80.0, 50.0)


def bare(*effects, thruster=()) -> Vehicle:
    """Neutral, with principal axes along the body's and both centres at CO."""
    inertia = ((1.5, 0.0, 0.0), (0.0, 5.0, 0.0), (0.0, 0.0, 5.5))
    zero = (0.0, 0.0, 0.0)
    return Vehicle(
        "bare",
        RigidBody(MASS, zero, inertia),
        Buoyancy(MASS * G, zero),
        Hull(1.6, 0.4, 0.3),
        thruster=thruster or (Thruster("ahead", 80.0, 60.0, zero, (1.0, 0.0, 0.0)),),
        effect=effects,
    )


def full() -> Vehicle:
    """A vehicle with a current, a load, a tether, a memory, lags and delays, all off the axes."""
    return Vehicle(
        "full",
        RigidBody(MASS, tuple(CG.tolist()), tuple(map(tuple, INERTIA.tolist()))),
        Buoyancy(BUOYANCY, tuple(CB.tolist())),
        Hull(1.6, 0.4, 0.3),
        thruster=(
            Thruster(
                "ahead", *LIMITS[:1] * 2, (-0.7, 0.1, 0.0), (1.0, 0.0, 0.0), time_constant=LAG, delay=DELAY
            ),
            Thruster(
                "side", *LIMITS[1:] * 2, (0.3, 0.0, 0.05), (0.0, 1.0, 0.0), time_constant=LAG, delay=DELAY
            ),
        ),
        effect=(
            {"name": "added_mass", "matrix": ADDED.tolist()},
            {"name": "linear_damping", "diagonal": LINEAR.tolist()},
            {"name": "quadratic_damping", "diagonal": QUADRATIC.tolist()},
            {"name": "ocean_current", **dict(zip(("v_N", "v_E", "v_D"), CURRENT.tolist(), strict=True))},
            {
                "name": "payload",
                "w": LOAD,
                "mass": LOAD_MASS,
                **dict(zip("xyz", LOAD_AT.tolist(), strict=True)),
            },
            {"name": "fluid_memory", "K": [MEMORY.tolist()], "rates": [RATE]},
            {
                "name": "tether",
                "k": TETHER,
                "slack": SLACK,
                "anchor": ANCHOR.tolist(),
                "attachment": ATTACHED.tolist(),
            },
        ),
    )


def S(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0.0]])


def coriolis(matrix, nu):
    """C(nu) nu of Fossen (3.46)."""
    a, b = np.split(matrix @ nu, 2)
    return np.concatenate([np.cross(nu[3:], a), np.cross(nu[:3], a) + np.cross(nu[3:], b)])


def equations(t, y, target):
    """Fossen's equations with Euler angles, a rigid body over ground and the water's part through nu_r."""
    position, angles, nu, thrust, memory = y[:3], y[3:6], y[6:12], y[12:14], y[14:]
    c, s = np.cos(angles), np.sin(angles)
    Rx = np.array([[1, 0, 0], [0, c[0], -s[0]], [0, s[0], c[0]]])
    Ry = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
    Rz = np.array([[c[2], -s[2], 0], [s[2], c[2], 0], [0, 0, 1.0]])
    R = Rz @ Ry @ Rx
    water = R.T @ CURRENT
    nu_r = nu - np.concatenate([water, np.zeros(3)])
    arm = np.hstack([np.eye(3), -S(CG)])
    rigid = MASS * arm.T @ arm
    rigid[3:, 3:] += INERTIA
    arm = np.hstack([np.eye(3), -S(LOAD_AT)])
    rigid += LOAD_MASS * arm.T @ arm

    def pull(point, force):
        local = R.T @ force
        return np.concatenate([local, np.cross(point, local)])

    line = ANCHOR - position - R @ ATTACHED
    distance = np.linalg.norm(line)
    memory_rate = nu_r - RATE * memory
    tau = (
        B @ thrust
        + pull(CG, np.array([0, 0, MASS * G]))
        + pull(CB, np.array([0, 0, -BUOYANCY]))
        + pull(LOAD_AT, np.array([0, 0, LOAD]))
        + pull(ATTACHED, TETHER * max(0.0, distance - SLACK) * line / distance)
        - LINEAR * nu_r
        - QUADRATIC * np.abs(nu_r) * nu_r
        - MEMORY * memory_rate
        - coriolis(rigid, nu)
        - coriolis(ADDED, nu_r)
        - ADDED @ np.concatenate([np.cross(nu[3:], water), np.zeros(3)])
    )
    nu_dot = np.linalg.solve(rigid + ADDED, tau)
    p, q, r = nu[3:]
    rates = [
        p + s[0] * s[1] / c[1] * q + c[0] * s[1] / c[1] * r,
        c[0] * q - s[0] * r,
        s[0] / c[1] * q + c[0] / c[1] * r,
    ]
    return np.concatenate([R @ nu[:3], rates, nu_dot, (target - thrust) / LAG, memory_rate])


def test_everything_at_once_against_solve_ivp():
    """1e-8 over two seconds; scipy stops and restarts wherever a delayed command comes through."""
    t = np.arange(100) * 0.02
    rng = np.random.default_rng(3)
    commands = np.repeat(rng.uniform(-1.0, 1.0, (20, 2)), 5, axis=0)
    eta, nu = np.array([0.5, 1.0, 4.0, 0.2, -0.3, 1.0]), np.array([0.5, -0.2, 0.1, 0.1, -0.2, 0.3])
    R = rotation(*eta[3:])
    memory = (nu - np.concatenate([R.T @ CURRENT, np.zeros(3)])) / RATE
    y, expected, now, target = (
        np.concatenate([eta, nu, np.zeros(2), memory]),
        [np.concatenate([eta, nu])],
        0.0,
        0.0,
    )
    for k in range(1, 100):
        due = [m * 0.02 + DELAY for m in range(100) if now < m * 0.02 + DELAY < t[k]]
        for until in [*due, t[k]]:
            target = (
                np.array(LIMITS) * commands[int(np.floor((now - DELAY) / 0.02 + 1e-6))]
                if now >= DELAY
                else 0.0
            )
            y = solve_ivp(equations, (now, until), y, "DOP853", rtol=1e-12, atol=1e-13, args=(target,)).y[
                :, -1
            ]
            now = until
        expected.append(y[:12])
    actual = trajectory(assemble(full()), commands, t, eta=eta, nu=nu)
    np.testing.assert_allclose(actual, expected, atol=1e-8, rtol=0)
    assert np.ptp(actual[:, 6]) > 0.3  # it did move


def still(vehicle, rows=200, *, command=(0.0,), **kwargs):
    """Motion under one held command, thrusters settled."""
    commands = np.tile(command, (rows, 1))
    return trajectory(assemble(vehicle), commands, np.arange(rows) * 0.02, settled=True, **kwargs)


def added(*diagonal):
    return {"name": "added_mass", "diagonal": list(diagonal)}


def test_terminal_speed_under_thrust():
    """X = d u + D u^2."""
    vehicle = bare(
        {"name": "linear_damping", "diagonal": [5.0] * 6},
        {"name": "quadratic_damping", "diagonal": [40.0] * 6},
    )
    u = (-5.0 + np.sqrt(25.0 + 4.0 * 40.0 * 32.0)) / 80.0
    assert still(vehicle, 2000, command=(0.4,))[-1, 6] == pytest.approx(u, abs=1e-9)


def test_coasting_down_with_linear_damping_is_exponential():
    motion = still(
        bare(added(10, 0, 0, 0, 0, 0), {"name": "linear_damping", "diagonal": [30.0] * 6}),
        nu=[2, 0, 0, 0, 0, 0],
    )
    np.testing.assert_allclose(motion[:, 6], 2.0 * np.exp(-30.0 / 60.0 * np.arange(200) * 0.02), atol=1e-11)


def test_free_ascent():
    """Quadratic drag from rest: w = -sqrt(dB/D) tanh(t sqrt(dB D)/m), and m includes the added mass."""
    vehicle = bare(
        added(0, 0, 65, 0, 0, 0),
        {"name": "quadratic_damping", "diagonal": [0, 0, 200.0, 0, 0, 0]},
        {"name": "net_buoyancy", "dB": 20.0},
    )
    t = np.arange(400) * 0.02
    motion = still(vehicle, 400, eta=[0, 0, 30, 0, 0, 0.3])
    np.testing.assert_allclose(motion[:, 8], -np.sqrt(0.1) * np.tanh(t * np.sqrt(4000.0) / 115.0), atol=1e-10)
    depth = 30.0 - 115.0 / 200.0 * np.log(np.cosh(t * np.sqrt(4000.0) / 115.0))
    np.testing.assert_allclose(motion[:, 2], depth, atol=1e-10)


def test_steady_turn():
    """X = d1 u - m22 v r, 0 = -m11 u r - d2 v, N = d6 r - (m11 - m22) u v, on a circle of radius U/r."""
    m11, m22, u, r = MASS + 12.0, MASS + 40.0, 1.2, 0.25
    v = -m11 * u * r / 90.0
    demand = (30.0 * u - m22 * v * r, 0.0, 0.0, 0.0, 0.0, 60.0 * r - (m11 - m22) * u * v)
    vehicle = bare(
        added(12, 40, 40, 0, 4, 4),
        {"name": "linear_damping", "diagonal": [30.0, 90.0, 90.0, 10.0, 60.0, 60.0]},
        thruster=(Thruster("turn", 1.0, 1.0, wrench=demand),),
    )
    motion = still(vehicle, 5000, command=(1.0,))
    np.testing.assert_allclose(motion[-1, 6:], [u, v, 0, 0, 0, r], atol=1e-9)
    circle = motion[-round(2 * np.pi / r / 0.02) :, :2]
    center = circle.mean(axis=0)
    np.testing.assert_allclose(np.linalg.norm(circle - center, axis=1), np.hypot(u, v) / r, rtol=2e-3)


def test_munk_moment_turns_the_bow_away_from_the_flow():
    """With M_A alone and a drift to starboard: r_dot = (M_A[0,0] - M_A[1,1]) u v / (I_z + M_A[5,5])."""
    motion = still(bare(added(10, 60, 60, 0, 8, 9)), 2, nu=[1.5, 0.2, 0, 0, 0, 0])
    assert motion[1, 11] == pytest.approx(-50.0 * 0.3 / (5.5 + 9.0) * 0.02, rel=1e-3)


@given(states())
@settings(max_examples=15)
def test_galilean_invariance(state):
    """In a current, all is as in still water seen from a boat that drifts along."""
    eta, nu = state
    vehicle = full()
    damped = [e for e in vehicle.effect if e["name"] not in ("tether", "ocean_current")]
    water = next(e for e in vehicle.effect if e["name"] == "ocean_current")
    commands = np.tile([0.6, -0.4], (100, 1))
    t = np.arange(100) * 0.02
    calm = trajectory(
        assemble(msgspec.structs.replace(vehicle, effect=tuple(damped))), commands, t, eta=eta, nu=nu
    )
    drift = np.concatenate([rotation(*eta[3:]).T @ CURRENT, np.zeros(3)])
    moved = msgspec.structs.replace(vehicle, effect=(*damped, water))
    carried = trajectory(assemble(moved), commands, t, eta=eta, nu=nu + drift)
    np.testing.assert_allclose(carried[:, :3], calm[:, :3] + np.outer(t, CURRENT), atol=1e-8)
    R, R_calm = rotation(*carried[:, 3:6].T), rotation(*calm[:, 3:6].T)
    np.testing.assert_allclose(R, R_calm, atol=1e-8)
    np.testing.assert_allclose(carried[:, 6:9] - np.einsum("kji,j->ki", R, CURRENT), calm[:, 6:9], atol=1e-8)


def test_left_alone_it_drifts_with_the_current():
    vehicle = bare(
        added(10, 60, 60, 0, 8, 9),
        {"name": "linear_damping", "diagonal": [50.0] * 6},
        {"name": "ocean_current", "v_N": 0.3, "v_E": -0.4},
    )
    motion = still(vehicle, 3000, eta=[0, 0, 5, 0, 0, 0.8])
    world = rotation(*motion[-1, 3:6]) @ motion[-1, 6:9]
    np.testing.assert_allclose(world, [0.3, -0.4, 0.0], atol=1e-6)


def test_through_the_vertical_nothing_happens():
    """A free body pitching over goes straight on, and its attitude comes round where Euler angles jump."""
    q, t = 2.0 * np.pi / 4.0, np.arange(201) * 0.02
    motion = still(bare(), 201, nu=[1.0, 0, 0, 0, q, 0])
    np.testing.assert_allclose(motion[:, :3], np.outer(t, [1.0, 0.0, 0.0]), atol=1e-9)
    np.testing.assert_allclose(motion[:, 6], np.cos(q * t), atol=1e-9)
    np.testing.assert_allclose(rotation(*motion[-1, 3:6]), np.eye(3), atol=1e-8)
    np.testing.assert_allclose(motion[:, 10], q, atol=1e-12)


def test_torque_free_motion_keeps_energy_and_angular_momentum():
    motion = still(bare(), 500, nu=[0.3, 0.1, -0.2, 2.0, 0.05, 1.0])
    inertia = np.diag([1.5, 5.0, 5.5])
    world = np.einsum("kij,kj->ki", rotation(*motion[:, 3:6].T), motion[:, 9:] @ inertia)
    np.testing.assert_allclose(world, np.tile(world[0], (500, 1)), atol=1e-7)
    energy = np.einsum("ki,ij,kj->k", motion[:, 9:], inertia, motion[:, 9:])
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)


def test_a_delay_of_whole_rows_shifts_the_motion():
    damping = {"name": "linear_damping", "diagonal": [30.0] * 6}
    commands, t = np.tile([0.7], (100, 1)), np.arange(100) * 0.02
    prompt = trajectory(assemble(bare(damping)), commands, t)
    late = trajectory(assemble(bare(damping, {"name": "command_delay", "d": 0.06})), commands, t)
    np.testing.assert_allclose(late[3:, 6], prompt[:-3, 6], atol=1e-12)
    assert not late[:4, 6].any()


@pytest.mark.parametrize("delay", [0.0, 0.0137])
def test_fourth_order_even_with_a_delay_within_a_step(delay):
    vehicle = msgspec.structs.replace(
        full(), effect=tuple(e for e in full().effect if e["name"] not in ("quadratic_damping", "tether"))
    )
    late = msgspec.structs.replace(vehicle, effect=(*vehicle.effect, {"name": "command_delay", "d": delay}))
    t = np.arange(60) * 0.02
    commands = np.stack([np.sin(9.0 * t), np.cos(5.0 * t)], axis=1)

    def at(steps):
        return trajectory(assemble(late), commands, t, nu=[1.0, 0.2, 0, 0.5, 0, 1.0], steps=steps)[-1]

    truth = at(64)
    coarse, fine = np.abs(at(4) - truth).max(), np.abs(at(8) - truth).max()
    assert 9.0 < coarse / fine < 30.0


@given(numbers(0.0, 0.3))
def test_sensor_effects_are_in_the_log_and_not_in_the_motion(bias):
    frame = pl.DataFrame({"session": ["a"] * 50, "t": np.arange(50) * 0.02, "cmd_1": np.full(50, 0.5)})
    plain = simulate(bare(), frame)
    biased = simulate(bare({"name": "sensor_bias", "b": [bias, 0.0, 0.0]}), frame)
    np.testing.assert_allclose(biased["u"], plain["u"] + bias, atol=1e-12)
    assert biased.select(POSE).equals(plain.select(POSE))


def raw(rows=50, session="a", start=0.0):
    """A raw table of a vehicle with one thruster, under way."""
    columns = {"session": [session] * rows, "t": start + np.arange(rows) * 0.02}
    for name in (*POSE, *VELOCITY):
        columns[name] = np.full(rows, 0.1)
    return pl.DataFrame(columns | {"cmd_1": np.linspace(-1.0, 1.0, rows)})


def test_a_raw_table_gives_its_own_first_state_and_gets_its_shape_back():
    frame = pl.concat([raw(), raw(session="b"), raw(session="b", start=3.0)])
    moved = simulate(bare({"name": "linear_damping", "diagonal": [30.0] * 6}), frame)
    assert moved.columns == frame.columns
    for first in (0, 50, 100):
        np.testing.assert_allclose(moved.row(first)[2:14], np.full(12, 0.1), atol=1e-12)
    again = simulate(bare({"name": "linear_damping", "diagonal": [30.0] * 6}), moved)
    np.testing.assert_allclose(again["u"], moved["u"], atol=1e-9)
    apart = simulate(bare({"name": "linear_damping", "diagonal": [30.0] * 6}), frame[:50])
    assert moved[:50].equals(apart)


def test_what_cannot_be_simulated():
    commands = raw().select("session", "t", "cmd_1")
    with pytest.raises(DataError, match="0 command columns, no cmd_1"):
        simulate(bare(), commands.drop("cmd_1"))
    with pytest.raises(DataError, match="all of them or none"):
        simulate(bare(), raw().drop("w"))
    gap = pl.concat([commands, raw(start=3.0).select("session", "t", "cmd_1")])
    with pytest.raises(DataError, match="a gap in t before row 50"):
        simulate(bare(), gap)
    with pytest.raises(DataError, match="finite rows of 1 thrusters"):
        simulate(bare(), commands.with_columns(cmd_1=float("nan")))
    with pytest.raises(DataError, match="some finite rows"):
        trajectory(assemble(bare()), np.empty((0, 1)), [])
    with pytest.raises(DataError, match="diverges by t = "):
        trajectory(
            assemble(bare({"name": "linear_damping", "diagonal": [-1e6] * 6})),
            np.ones((500, 1)),
            np.arange(500) * 0.02,
        )
