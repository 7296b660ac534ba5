"""Embedded reference simulator, compared with independent equations, closed forms and symmetries."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hydro.core.distillation.labels import labels
from hydro.core.errors import DataError
from hydro.core.simulation.excitation import DECKS
from hydro.core.simulation.sensor_noise import PROFILES
from hydro.core.vehicle.description import Buoyancy, Hull, RigidBody, Thruster, Vehicle
from hydro.core.vehicle.ellipsoid import added_mass_matrix
from hydro.core.vehicle.frames import rotation
from hydro.core.vehicle.panels import FORM_DRAG, SKIN_FRICTION, panel_wrench, superellipsoid
from hydro.core.vehicle.rigid_body import coriolis_matrix, mass_matrix, potential, restoring
from hydro.core.vehicle.thrusters import configuration_matrix
from hydro.io.vehicle import read
from hydro.sim.teacher import Programme, collect, fly, teacher

PRESETS = sorted((Path(__file__).resolve().parents[2] / "datasets" / "vehicles").glob("*.toml"))
THRUST_ALONE = [path for path in PRESETS if all(each.pushes for each in read(path)[0].thruster)]
"""Presets without fins: programmes of forces in six axes do not steer fins."""
MASS, RHO, G = 120.0, 1025.0, 9.81
T = 0.12
NAMES = ("x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r")


def craft(*, thrusters: bool = True, excess: float = 3.0, **keys: object) -> Vehicle:
    """Return an asymmetric vehicle: hull off the origin, low centre of gravity, one demand per axis."""
    wrenches = np.eye(6) if thrusters else np.empty((0, 6))
    return Vehicle(
        name="test",
        rigid_body=RigidBody(MASS, (0.02, -0.01, 0.06), ((5.0, 0.1, 0), (0.1, 14.0, 0), (0, 0, 15.0))),
        buoyancy=Buoyancy(MASS * G + excess, (0.02, -0.01, -0.02)),
        hull=Hull(1.2, 0.6, 0.5, (0.05, 0.0, 0.02)),
        thruster=tuple(
            Thruster(f"T{i}", 200.0, 200.0, wrench=tuple(w), time_constant=T) for i, w in enumerate(wrenches)
        ),
        **keys,
    )


def demand(rows: int, **axes: float) -> np.ndarray:
    names = ("surge", "sway", "heave", "roll", "pitch", "yaw")
    return np.tile([axes.get(name, 0.0) for name in names], (rows, 1))


def panel_force(subject, nu):
    """Return the force of the panel method, in array equations."""
    r, n, area = subject.hull.table[:3].T, subject.hull.table[3:6].T, subject.hull.table[6]
    v = nu[:3] + np.cross(nu[3:], r)
    normal = (v * n).sum(axis=1)
    tangential = v - normal[:, None] * n
    force = -0.5 * RHO * FORM_DRAG * (area * np.clip(normal, 0, None) ** 2)[:, None] * n
    force -= 0.5 * RHO * SKIN_FRICTION * (area * np.linalg.norm(tangential, axis=1))[:, None] * tangential
    return np.array([*force.sum(axis=0), *np.cross(r, force).sum(axis=0)])


def test_motion_is_that_of_scipy_on_the_same_equations():
    """Rigid body, ellipsoid, panels, restoring forces and thruster lag, independently in Euler angles."""
    vehicle = craft()
    subject = teacher(vehicle)
    rows = 120
    t = np.arange(rows) * 0.02
    shares = 0.8 * np.sin(np.outer(t, [3.0, 2.0, 2.5, 5.0, 4.0, 3.5]) + np.arange(6))
    motion, commands = fly(subject, shares, heading=0.7, nu=[0.4, -0.2, 0.1, 0.1, 0.2, -0.3])
    hull = vehicle.hull
    M_A = added_mass_matrix((hull.length / 2, hull.width / 2, hull.height / 2), RHO, hull.center)
    M, B = mass_matrix(vehicle) + M_A, configuration_matrix(vehicle)

    def rates(time, y, target, before, begin):
        phi, theta, psi = y[3:6]
        nu = y[6:]
        thrust = target + (before - target) * np.exp(-(time - begin) / T)
        tau = B @ thrust + restoring(vehicle, phi, theta) + panel_force(subject, nu)
        nu_dot = np.linalg.solve(M, tau - coriolis_matrix(M, nu) @ nu)
        s, c, tan = np.sin(phi), np.cos(phi), np.tan(theta)
        turn = np.array([[1, s * tan, c * tan], [0, c, -s], [0, s / np.cos(theta), c / np.cos(theta)]])
        return np.concatenate([rotation(phi, theta, psi) @ nu[:3], turn @ nu[3:], nu_dot])

    y, thrust = motion[0].copy(), np.zeros(6)
    for k in range(rows - 1):
        target = 200.0 * commands[k]
        span = (t[k], t[k + 1])
        solution = solve_ivp(
            rates, span, y, args=(target, thrust, t[k]), method="DOP853", rtol=1e-9, atol=1e-11
        )
        y = solution.y[:, -1]
        thrust = target + (thrust - target) * np.exp(-0.02 / T)
        np.testing.assert_allclose(motion[k + 1], y, atol=2e-6)
    assert np.abs(motion[:, 6:]).max() > 0.3


@settings(max_examples=10)
@given(st.tuples(*[st.floats(-1.5, 1.5)] * 6))
def test_a_hull_left_to_itself_loses_energy(nu):
    vehicle = craft(thrusters=False)
    subject = teacher(vehicle)
    motion, _ = fly(subject, np.zeros((300, 6)), nu=nu)
    M = mass_matrix(vehicle) + subject.added_mass
    kinetic = 0.5 * np.einsum("ki,ij,kj->k", motion[:, 6:], M, motion[:, 6:])
    energy = kinetic + potential(vehicle, motion[:, 2], motion[:, 3], motion[:, 4])
    assert np.diff(energy).max() <= 1e-6 * (1 + np.ptp(energy))


@settings(max_examples=10)
@given(st.tuples(*[st.floats(-0.5, 0.5)] * 2), st.floats(-3, 3), st.tuples(*[st.floats(-0.5, 0.5)] * 6))
def test_motion_through_the_water_does_not_know_of_a_uniform_current(current, heading, nu):
    """Galilean invariance: at equal velocity through the water, only the pose drifts."""
    shares = demand(200, surge=0.3, yaw=0.2, heave=0.1)
    still, still_commands = fly(teacher(craft()), shares, heading=heading, nu=nu)
    hidden = [{"name": "ocean_current", "v_N": current[0], "v_E": current[1]}]
    carried = np.concatenate([rotation(0, 0, heading).T @ [*current, 0], np.zeros(3)])
    moved, commands = fly(teacher(craft(), hidden=hidden), shares, heading=heading, nu=np.add(nu, carried))
    t = np.arange(200)[:, None] * 0.02
    np.testing.assert_allclose(moved[:, :2] - t * current, still[:, :2], atol=1e-7)
    np.testing.assert_allclose(moved[:, 2:6], still[:, 2:6], atol=1e-7)
    water = rotation(*moved[:, 3:6].T).swapaxes(1, 2) @ [*current, 0]
    np.testing.assert_allclose(moved[:, 6:9] - water, still[:, 6:9], atol=1e-7)
    np.testing.assert_allclose(commands, still_commands, atol=1e-6)


def test_terminal_speed_balances_drag():
    vehicle = msgspec.structs.replace(craft(excess=0.0), hull=Hull(1.2, 0.6, 0.5))
    subject = teacher(vehicle)
    motion, commands = fly(subject, demand(3000, surge=0.5), hold_heading=True)
    drag = -panel_wrench(subject.hull, [1, 0, 0, 0, 0, 0], RHO)[0]
    assert motion[-1, 6] == pytest.approx(np.sqrt(200 * commands[-1, 0] / drag), rel=2e-3)


def test_buoyant_ascent_reaches_its_closed_form():
    vehicle = msgspec.structs.replace(
        craft(thrusters=False, excess=40.0),
        hull=Hull(1.2, 0.6, 0.5),
        rigid_body=RigidBody(MASS, (0.0, 0.0, 0.2), ((5.0, 0, 0), (0, 14.0, 0), (0, 0, 15.0))),
        buoyancy=Buoyancy(MASS * G + 40.0, (0.0, 0.0, 0.0)),
    )
    subject = teacher(vehicle)
    motion, _ = fly(subject, np.zeros((3000, 6)), depth=100.0)
    drag = -panel_wrench(subject.hull, [0, 0, 1, 0, 0, 0], RHO)[2]
    assert motion[-1, 8] == pytest.approx(-np.sqrt(40.0 / drag), rel=1e-3)


def test_the_files_own_water_is_ignored_and_all_else_acts():
    water = (
        {"name": "added_mass", "diagonal": [500.0] * 6},
        {"name": "linear_damping", "diagonal": [900.0] * 6},
        {"name": "crossflow_drag", "Cd_y": 2.0, "Cd_z": 2.0},
    )
    kept = ({"name": "net_buoyancy", "dB": 30.0}, {"name": "body_lift", "L11": 20.0})
    plain, loaded = teacher(craft()), teacher(craft(effect=(*water, *kept)))
    assert loaded.ignored == ("added_mass", "linear_damping", "crossflow_drag")
    assert plain.ignored == ()
    np.testing.assert_array_equal(teacher(craft(effect=water)).program.flat, plain.program.flat)
    assert loaded.program.effects == ("net_buoyancy", "body_lift")


@pytest.mark.parametrize(
    ("hidden", "shows"),
    [
        ({"name": "net_buoyancy", "dB": 30.0}, lambda with_it, without: with_it["z"] < without["z"]),
        ({"name": "ocean_current", "v_E": 0.4}, lambda with_it, without: with_it["y"] > without["y"] + 2),
        (
            {"name": "linear_damping", "diagonal": [80.0, 0, 0, 0, 0, 0]},
            lambda with_it, without: with_it["u"] < 0.9 * without["u"],
        ),
        (
            {"name": "thruster_gain", "g": [-0.5, 0, 0, 0, 0, 0]},
            lambda with_it, without: with_it["u"] == pytest.approx(np.sqrt(0.5) * without["u"], rel=0.1),
        ),
        ({"name": "sensor_scale", "s": 0.1}, lambda with_it, without: with_it["x"] == without["x"]),
    ],
    ids=lambda value: value["name"] if isinstance(value, dict) else "",
)
def test_what_is_hidden_shows_in_the_motion(hidden, shows):
    ends = []
    for subject in (teacher(craft(), hidden=[hidden]), teacher(craft())):
        motion, _ = fly(subject, demand(750, surge=0.4), hold_heading=True)
        ends.append(dict(zip(NAMES, motion[-1], strict=True)))
    assert shows(*ends)


def test_what_couples_axes_is_hidden_beside_the_files_damping():
    """Coupled damping alone is not passive; the file's damping describes that of the panels."""
    coupled = {"name": "coupled_damping", "D15": -20.0, "D51": -20.0}
    damping = {"name": "linear_damping", "diagonal": [50.0] * 6}
    with pytest.raises(DataError, match="positive semi-definite"):
        teacher(craft(), hidden=[coupled])
    with pytest.raises(DataError, match="positive semi-definite"):
        teacher(craft(effect=(damping,)), hidden=[coupled | {"D15": -90.0, "D51": -90.0}])
    subject = teacher(craft(effect=(damping,)), hidden=[coupled])
    assert subject.program.effects == ("coupled_damping",)
    assert subject.ignored == ("linear_damping",)


def test_a_hidden_sensor_error_is_in_the_log_and_not_in_the_motion():
    clean = collect(teacher(craft()), 1500, 4)
    wrong = collect(teacher(craft(), hidden=[{"name": "sensor_scale", "s": 0.1}]), 1500, 4)
    same = ["session", "t", "x", "y", "z", "phi", "theta", "psi", "p", "q", "r", *clean.columns[14:]]
    assert wrong.select(same).equals(clean.select(same))
    np.testing.assert_allclose(wrong["u"].to_numpy(), 1.1 * clean["u"].to_numpy(), rtol=1e-5, atol=1e-6)


def test_commands_are_of_their_row_and_delay_is_felt_late():
    subject = teacher(craft(), hidden=[{"name": "command_delay", "d": 0.1}])
    late, _ = fly(subject, demand(60, surge=0.5))
    prompt, commands = fly(teacher(craft()), demand(60, surge=0.5))
    assert commands[0, 0] > 0, "the first command is given in the first row"
    assert prompt[0, 6] == 0
    assert prompt[1, 6] > 0, "and felt by the second"
    np.testing.assert_allclose(late[5, 6], 0, atol=1e-4)
    np.testing.assert_allclose(late[6:, 6], prompt[1:-5, 6], atol=2e-3)


def test_the_same_seed_gives_the_same_rows_on_any_number_of_threads():
    subject = teacher(craft())
    reports: list[int] = []
    one = collect(subject, 4000, 7, noise=PROFILES["ordinary"], threads=1, report=reports.append)
    two = collect(subject, 4000, 7, noise=PROFILES["ordinary"], threads=2)
    other = collect(subject, 4000, 8, noise=PROFILES["ordinary"], threads=2)
    assert one.equals(two)
    assert not one.equals(other)
    assert reports == sorted(reports)
    assert reports[-1] == one.height == 4000


def test_noise_is_on_the_log_alone_and_of_its_size():
    subject = teacher(craft())
    clean = collect(subject, 20_000, 3)
    noisy = collect(subject, 20_000, 3, noise=PROFILES["dvl"])
    commands = [name for name in clean.columns if name.startswith("cmd_")]
    assert noisy.select("session", "t", *commands).equals(clean.select("session", "t", *commands))
    for columns, sigma in (("xyz", 0.02), ("uvw", 0.05), ("pqr", 0.01), (("phi", "theta"), 0.002)):
        for column in columns:
            assert (noisy[column] - clean[column]).std() == pytest.approx(sigma, rel=0.05), column


def test_a_recording_is_sampled_at_50_hz_from_rest_at_depth():
    frame = collect(teacher(craft()), 3000, 0, programme=Programme(depth=35.0))
    assert frame.columns[:14] == ["session", "t", *NAMES]
    first = frame.group_by("session", maintain_order=True).first()
    assert first.select("u", "v", "w", "p", "q", "r", "x", "y").to_numpy().any() == np.False_
    assert first["z"].to_list() == [35.0] * first.height
    assert first["psi"].n_unique() == first.height > 1, "every session starts on a heading of its own"
    for _, session in frame.group_by("session"):
        np.testing.assert_allclose(session["t"].to_numpy(), np.arange(session.height) / 50, atol=1e-12)
    assert frame.select(pl.col("^cmd_.*$").abs().max()).to_numpy().max() <= 1.0


@pytest.mark.parametrize("path", THRUST_ALONE, ids=lambda path: path.stem)
@pytest.mark.parametrize("excitation", sorted(DECKS))
def test_every_preset_keeps_upright_and_under_water_and_is_excited(path, excitation):
    vehicle, _ = read(path)
    frame = collect(teacher(vehicle), 6000, 1, programme=Programme(excitation))
    tilt = frame.select(pl.col("phi", "theta").abs().max()).to_numpy()
    assert tilt.max() < 1.3
    assert frame["z"].min() > 20.0
    assert frame["u"].std() + frame["v"].std() > 0.03
    assert frame["r"].std() > 0.03


def test_labels_of_a_recording_are_the_water_that_made_it():
    """tau_res = C(nu) nu - panels if the file has the added mass of the simulator."""
    M_A = teacher(craft()).added_mass
    vehicle = craft(effect=({"name": "added_mass", "matrix": M_A.tolist()},))
    subject = teacher(vehicle)
    labelled = labels(vehicle, collect(subject, 3000, 2))
    nu = labelled.select("u", "v", "w", "p", "q", "r").to_numpy().astype(np.float64)
    coriolis = np.einsum("kij,kj->ki", coriolis_matrix(mass_matrix(vehicle) + M_A, nu), nu)
    expected = coriolis - np.array([panel_wrench(subject.hull, row, RHO) for row in nu])
    found = labelled.select("X_res", "Y_res", "Z_res", "K_res", "M_res", "N_res").to_numpy()
    error = np.sqrt(np.mean((found - expected) ** 2, axis=0))
    assert (error < 0.02 * np.sqrt(np.mean(expected**2, axis=0))).all()


def test_the_hull_must_be_the_files():
    vertices, faces = superellipsoid(1.2, 0.6, 0.5, (0.05, 0.0, 0.02))
    same = teacher(craft(), mesh=(vertices, faces))
    np.testing.assert_array_equal(same.facets, teacher(craft()).facets)
    with pytest.raises(DataError, match=r"hull\.mesh: the mesh is 1.2e\+03 x 600 x 500 m, but \[hull\] says"):
        teacher(craft(), mesh=(1000 * vertices, faces))
    with pytest.raises(DataError, match="inside out"):
        teacher(craft(), mesh=(vertices, faces[:, ::-1]))


def test_bad_input_is_told():
    subject = teacher(craft())
    with pytest.raises(DataError, match="not in the catalogue"):
        teacher(craft(), hidden=[{"name": "magic"}])
    with pytest.raises(DataError, match="no such parameter"):
        teacher(craft(), hidden=[{"name": "ocean_current", "north": 1.0}])
    with pytest.raises(DataError, match="there are hybrid"):
        collect(subject, 100, 0, programme=Programme("jumps"))
    with pytest.raises(DataError, match="thrusters produce no axis"):
        collect(teacher(craft(thrusters=False)), 100, 0)
    explosive = [{"name": "body_lift", "L11": -1e6}]
    with pytest.raises(DataError, match="diverges by t ="):
        fly(teacher(craft(), hidden=explosive), demand(500, surge=0.5, sway=0.1))


def test_hidden_waves_move_the_teacher_by_seed_and_session_and_never_its_calm_water() -> None:
    waves = {"name": "ocean_waves", "height": 0.6, "period": 4.0, "direction": 0.7}
    calm, rough = teacher(craft()), teacher(craft(), hidden=[waves])
    still = demand(200)
    at_rest, _ = fly(calm, still, depth=3.0)
    moved = [fly(rough, still, depth=3.0, sea=sea)[0] for sea in ((1, 1), (1, 1), (1, 2))]
    np.testing.assert_array_equal(moved[0], moved[1])
    assert np.abs(moved[0] - moved[2])[:, 6:9].max() > 0.02
    assert np.abs(moved[0] - at_rest)[:, 6:9].max() > 0.05
    flat, _ = fly(teacher(craft(), hidden=[waves | {"height": 0.0}]), still, depth=3.0, sea=(1, 1))
    np.testing.assert_array_equal(flat, at_rest)
