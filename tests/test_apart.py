"""A simulator that shares no code with hydro: its physics, its tables, and the right name of each change."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from benchmarks.apart import owner, recordings
from benchmarks.apart.cases import CASES, draw
from benchmarks.apart.changes import CHANGES, changed
from benchmarks.apart.frames import G, rotation
from benchmarks.apart.hulls import HULLS, fins
from benchmarks.apart.judgement import FAULT, NAMES
from benchmarks.apart.make import plain
from benchmarks.apart.simulator import ROW, Simulator
from benchmarks.apart.vehicles import MAKERS
from hydro.core.effects import CATALOGUE
from hydro.core.vehicle.description import Vehicle
from hydro.io import table
from hydro.io import vehicle as files

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "benchmarks" / "apart"
VEHICLES = {name: MAKERS[name](np.random.default_rng(3)) for name in MAKERS}
ALL = pytest.mark.parametrize("name", VEHICLES)
START = [[0.0, 0.0, 20.0]]
MOVING = [[0.4, 0.3, -0.2, 0.5, -0.4, 0.3]]


def stripped(name, **more):
    """Parameters of a vehicle that the water takes nothing from."""
    vehicle = VEHICLES[name]
    return vehicle.P | {"hull": 0.0, "fin_area": np.zeros(4), "thr_c": np.zeros(vehicle.n)} | more


def flown(name, P, rows, nu, att=(0.2, -0.3, 1.0), command=None, **more):
    """States (rows, S) of one vehicle, and its simulator."""
    simulator = Simulator(VEHICLES[name].kind, [P], **more)
    x = simulator.initial(START, [att], nu)
    quiet = np.zeros((1, simulator.n))
    states, _, _ = simulator.run(x, rows, command or (lambda k, m: quiet))
    return states[:, 0], simulator


def test_nothing_of_hydro_is_imported():
    imports = [
        (path.stem, name)
        for path in sorted(PACKAGE.glob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in ([each.name for each in node.names] if isinstance(node, ast.Import) else [node.module])
    ]
    assert len(imports) > 20
    assert [(path, name) for path, name in imports if name.split(".")[0] == "hydro"] == []
    assert [name for _, name in imports if name.startswith("benchmarks.") and ".apart" not in name] == []


@ALL
def test_energy_is_kept_where_the_water_takes_none(name):
    P = stripped(name)
    states, simulator = flown(name, P, 100, MOVING)
    M = (simulator.Mrb + simulator.Ma)[0]

    def energy(x):
        kinetic = 0.5 * x[7:13] @ M @ x[7:13]
        down = rotation(x[3:7])[2]
        weight, lift = P["mass"] * G * (x[2] + down @ P["cg"]), P["buoy"] * (x[2] + down @ P["cb"])
        return kinetic, kinetic - weight + lift

    first, last = energy(states[0]), energy(states[-1])
    assert abs(last[1] - first[1]) < 1e-5 * first[0]
    assert np.abs(states[-1, 7:13] - states[0, 7:13]).max() > 0.02


@ALL
def test_momentum_is_kept_without_weight(name):
    states, simulator = flown(name, stripped(name, mass_w=0.0, buoy=0.0), 80, MOVING)
    M = (simulator.Mrb + simulator.Ma)[0]
    first, last = (rotation(x[3:7]) @ (M @ x[7:13])[:3] for x in states[[0, -1]])
    np.testing.assert_allclose(last, first, atol=1e-6 * np.abs(first).max())


@ALL
def test_a_steady_current_only_carries_along(name):
    current = np.array([0.3, -0.2, 0.05])
    P = VEHICLES[name].P
    kind, n = VEHICLES[name].kind, VEHICLES[name].n
    simulator = Simulator(kind, [P, P | {"vc": current}])
    x = simulator.initial(START * 2, [[0.0, 0.0, 1.0]] * 2, [[0.2, 0, 0, 0, 0, 0]] * 2)
    x[1, 7:10] += rotation(x[1, 3:7]).T @ current
    x[1, 17 + n :] = x[0, 17 + n :]
    command = 0.3 * np.sin(0.05 * np.arange(60)[:, None] * np.arange(1, n + 1))
    states, _, _ = simulator.run(x, 60, lambda k, m: np.stack([command[k]] * 2))
    t = np.arange(60)[:, None] * ROW
    np.testing.assert_allclose(states[:, 1, :3], states[:, 0, :3] + t * current, atol=1e-9)
    assert np.ptp(states[:, 0, :2], axis=0).max() > 0.1


@ALL
def test_a_finer_step_changes_little(name):
    command = 0.3 * np.sin(np.arange(1, VEHICLES[name].n + 1))[None]
    coarse, fine = (
        flown(name, VEHICLES[name].P, 30, [[0.2, 0, 0, 0, 0, 0]], command=lambda k, m: command, step=step)[0]
        for step in (0.01, 0.005)
    )
    np.testing.assert_allclose(coarse[:, :13], fine[:, :13], atol=1e-5)


@given(nu=arrays(float, (40, 6), elements=st.floats(-2, 2)))
@settings(max_examples=15, deadline=None)
def test_hulls_and_fins_take_energy(nu):
    for vehicle in VEHICLES.values():
        P = {k: np.repeat(np.asarray(v, float)[None], 40, 0) for k, v in vehicle.P.items()}
        size = (nu**2).sum(1) + 1e-9
        assert ((HULLS[vehicle.kind](P, nu) * nu).sum(1) <= 1e-6 * size).all()
        assert ((fins(P, nu, np.zeros((40, 4))) * nu).sum(1) <= 1e-6 * size).all()


def test_terminal_speed_of_a_torpedo_balances_thrust_and_drag():
    P = VEHICLES["driven"].P
    level = {"buoy": P["mass"] * G, "cg_w": np.array([0, 0, P["cg"][2]]), "thr_k": np.zeros(3)}
    P = P | level | {"Ma": np.diag(np.diag(P["Ma"]))}
    command, start = np.array([[0.8, 0, 0]]), [[1.3, 0, 0, 0, 0, 0]]
    states, _ = flown("driven", P, 1200, start, (0, 0, 0), lambda k, m: command, step=0.02)
    u = states[-1, 7]
    thrust = P["thr_max"][0] * 0.8 ** P["thr_pow"][0]
    thrust -= P["thr_c"][0] * np.sqrt(thrust * P["thr_max"][0]) * u
    one = {k: np.asarray(v, float)[None] for k, v in P.items()}
    of_fins = -fins(one, np.array([[u, 0, 0, 0, 0, 0.0]]), np.zeros((1, 4)))[0, 0]
    assert P["kx"] * u**1.85 + of_fins == pytest.approx(thrust, rel=1e-3)
    assert abs(u - 1.3) > 0.05


@pytest.mark.parametrize("delay", [0.0, 0.02, 0.05])
def test_commands_hold_from_their_row_on_and_late_by_the_delay(delay):
    P = VEHICLES["rov"].P | {"thr_delay": delay}
    held = np.full((1, 8), 0.5)
    states, simulator = flown("rov", P, 16, np.zeros((1, 6)), (0, 0, 0), lambda k, m: held * (k >= 10))
    thrust = states[:, 13] / simulator.target(held)[0, 0]
    since = np.clip((np.arange(16) - 10) * ROW - delay, 0, None)
    np.testing.assert_allclose(thrust, 1 - np.exp(-since / P["thr_tau"][0]), atol=1e-4)


@ALL
def test_a_file_is_read_and_fits_its_vehicle(name):
    vehicle, rng = VEHICLES[name], np.random.default_rng(1)
    text = owner.file(vehicle, name, owner.effects(vehicle, rng, 0.1), rng)
    read = files.parse(text)
    assert isinstance(read, Vehicle)
    assert len(read.thruster) == vehicle.n
    assert {each["name"].split(":")[0] for each in read.effect} - {"control_surface"} == set(vehicle.own)
    assert sum(each["name"].startswith("control_surface:") for each in read.effect) == 2 * vehicle.driven


def test_a_table_passes_the_raw_schema_and_comes_from_its_seed(monkeypatch, tmp_path):
    monkeypatch.setattr(recordings, "ROWS", 40)
    drawn = [each for each in (draw(3, place) for place in range(len(CASES))) if each.maker == "driven"][:2]
    one = [recordings.Recording(drawn[0], "before", drawn[0].vehicle.P)]
    other = [recordings.Recording(drawn[1], "before", None)]
    both = [*one, recordings.Recording(drawn[1], "before", drawn[1].vehicle.P)]
    rows = [40, 30] + [25] * 7
    alone, beside, together = (
        recordings.table(recordings.fly(those, 3)[drawn[0].place, "before"], rows, {}, "b")
        for those in (one, one + other, both)
    )
    assert table.make("raw", alone, stage="test").frame.height == sum(rows)
    assert beside.equals(together)  # whoever flies beside it
    assert not alone.equals(beside)  # noise is that of the batch


def test_logs_misread_what_they_are_said_to(monkeypatch):
    monkeypatch.setattr(recordings, "ROWS", 30)
    drawn = draw(3, next(place for place in range(len(CASES)) if draw(3, place).maker == "hover"))
    flight = recordings.fly([recordings.Recording(drawn, "fit", drawn.vehicle.P)], 3)[drawn.place, "fit"][0]
    true, noise = flight.states[:, 7:10], flight.noise[:, 6:9]
    plainly = recordings.sensed(flight, 30, {})
    turned = recordings.sensed(flight, 30, {"sensor": "yaw", "alpha": 0.1})[:, 6:9] - noise
    np.testing.assert_allclose(turned[:, 0], np.cos(0.1) * true[:, 0] + np.sin(0.1) * true[:, 1])
    late = recordings.sensed(flight, 30, {"sensor": "late", "d": 0.2})[:, 6:9] - noise
    np.testing.assert_allclose(late[10:], true[:-10], atol=1e-12)
    off = recordings.sensed(flight, 30, {"sensor": "heading", "bias": 0.1})
    np.testing.assert_allclose(np.exp(1j * (off[:, 5] - plainly[:, 5])), np.exp(0.1j))
    both = recordings.logged(recordings.logged(flight.commands, [2, 4]), [4, 2])
    np.testing.assert_array_equal(both, flight.commands)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_every_change_changes_what_it_says_and_grows_in_size_alone(case):
    vehicle = VEHICLES[case.vehicles[-1]]
    (small, truth), (large, _) = (
        changed(case.kind, vehicle, np.random.default_rng(2), size) for size in (1.0, 1.5)
    )
    differ = {key for key in vehicle.P if not np.array_equal(small[key], vehicle.P[key])}
    assert bool(differ) == bool(truth and not {"sensor", "columns"} & set(truth))
    assert {key for key in vehicle.P if not np.array_equal(large[key], vehicle.P[key])} == differ
    json.dumps(plain(truth))


def test_the_table_of_names_covers_every_change_and_names_what_there_is():
    assert set(NAMES) == set(CHANGES) == {case.kind for case in CASES}
    for names in NAMES.values():
        assert names.why
        assert {*names.right, *names.alias} <= {*CATALOGUE, FAULT}
        assert not set(names.right) & set(names.alias)
