"""Thruster audit on the log of a vehicle that scipy moved: directions, order, scale, and blind spots."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import polars as pl
import pytest
import synthetic
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import damped, moved

from hydro.core.audit import thrusters
from hydro.core.audit.momentum_balance import Balance
from hydro.core.audit.thrusters import audit
from hydro.core.audit.wiring import Wiring
from hydro.core.columns import POSE, VELOCITY
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.recording.arrays import recording
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.thrusters import allocate, configuration_matrix

N = 8


def noisy(raw: pl.DataFrame) -> pl.DataFrame:
    logged = disturb(raw.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], np.random.default_rng(0))
    return raw.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))


@pytest.fixture(scope="module")
def log() -> pl.DataFrame:
    return noisy(moved(damped(), rows=2500))


def drawn(log: pl.DataFrame, column, sign) -> pl.DataFrame:
    """The log with its columns so that `column[i]`, times `sign[i]`, drives thruster i."""
    back = np.argsort(column)
    values = {f"cmd_{j + 1}": sign[i] * log[f"cmd_{i + 1}"] for j, i in enumerate(back)}
    return log.with_columns(**values)


def audited(raw: pl.DataFrame, vehicle=None):
    vehicle = vehicle or damped()
    return audit(vehicle, recording(vehicle, raw))


def test_a_servo_has_no_direction_to_audit(log):
    servo = type(synthetic.vehicle().thruster[0])(name="fin", curve="none")
    vehicle = damped()
    vehicle = msgspec.structs.replace(vehicle, thruster=(servo, *vehicle.thruster))
    names = [f"cmd_{i + 1}" for i in range(N)]
    raw = log.rename({name: f"cmd_{i + 2}" for i, name in enumerate(names)})
    raw = raw.with_columns(cmd_1=pl.lit(0.3), cmd_4=-pl.col("cmd_4"))
    found = audited(raw, vehicle)
    assert found.wiring.reversed == (3,)
    assert np.isnan(found.effectiveness[0])
    assert (found.seen[0], found.clear[0], found.idle[0]) == (False, False, False)


@pytest.mark.parametrize(
    "beside",
    [
        [],
        [{"name": "thruster_gain", "g": [-0.95, 0, 0, 0.2, 0, -0.4, 0, 0]}],
        [{"name": "ocean_current", "v_N": 0.3, "v_E": -0.2}],
        [{"name": "payload", "w": 30.0, "x": 0.4, "mass": 10.0}],
        [{"name": "thruster_asymmetry", "a": 0.4}, {"name": "thruster_deadband", "d": 0.1}],
    ],
)
def test_a_sound_log_is_left_alone_whatever_else_is_missing(beside):
    raw = noisy(moved(damped(*beside), rows=2500, seed=1))
    assert not audited(raw).wrong
    assert preprocess(damped(), raw).wiring is None


@pytest.mark.parametrize("place", [(0.6, 0.0, 0.0), (-0.5, -0.3, 0.2), (0.0, 0.3, -0.25)])
def test_a_velocity_log_away_from_the_origin_is_no_matter_of_thrusters(place):
    """What it logs has omega x r besides: closed form."""
    raw = noisy(moved(damped(), rows=2500, seed=1))
    rates = raw.select("p", "q", "r").to_numpy()
    logged = raw.select("u", "v", "w").to_numpy() + np.cross(rates, place)
    found = audited(raw.with_columns(pl.DataFrame(logged, schema=["u", "v", "w"])))
    assert not found.wrong
    assert (found.low < 1.0).all()
    assert (found.high > 1.0).all()


def test_values_at_their_bounds_may_be_otherwise(log):
    """A power of 4, the most that a formula may have, is what a study may end at."""
    steep = {"name": "formula", "forces": ["X |u|^n sgn(u)"], "force": [-1e-3], "exponents": [4.0]}
    assert not audited(log, damped(steep)).wrong


@settings(max_examples=8)
@given(data=st.data())
def test_columns_that_are_exchanged_or_reversed_are_found(log, data):
    pair = data.draw(st.lists(st.integers(0, N - 1), min_size=2, max_size=3, unique=True))
    column, sign = list(range(N)), [1] * N
    for i, k in zip(pair, pair[1:] + pair[:1], strict=True):
        column[i] = k
    reversed_ = data.draw(st.integers(0, N - 1))
    sign[reversed_] = -1
    raw = drawn(log, column, sign)
    found = preprocess(damped(), raw)
    assert found.wiring == Wiring(tuple(column), tuple(sign))
    commands = [f"cmd_{i + 1}" for i in range(N)]
    np.testing.assert_array_equal(found.raw.select(commands), log.select(commands))
    (fault,) = found.faults
    assert fault.verdict == "log_fault"
    assert fault.confidence > 0.95
    assert f"cmd_{column[pair[0]] + 1}" in fault.members


@settings(max_examples=8)
@given(subset=st.sets(st.integers(0, N - 1), min_size=1))
def test_any_subset_of_reversed_thrusters_is_found(log, subset):
    sign = [-1 if i in subset else 1 for i in range(N)]
    found = audited(drawn(log, range(N), sign))
    assert found.wiring == Wiring(tuple(range(N)), tuple(sign))
    np.testing.assert_array_equal(np.sign(found.effectiveness), sign)
    assert ((found.low <= sign) & (sign <= found.high)).all()
    numbers = ",".join(str(i + 1) for i in sorted(subset))
    assert f"`hydro vehicle flip a.toml --thruster {numbers} -o" in found.headline("a.toml")


def test_the_other_end_first_is_found(log):
    raw = drawn(log, list(range(N))[::-1], [1] * N)
    assert preprocess(damped(), raw).wiring == Wiring(tuple(range(N))[::-1], (1,) * N)


def test_swapped_columns_come_with_the_line_of_the_map(log):
    found = audited(drawn(log, [0, 1, 3, 2, *range(4, N)], [1] * N))
    sources = [f"out{i}" for i in range(N)]
    assert found.headline(sources=sources) == (
        "columns 3 and 4 are swapped (100 % sure): write in the map, under [commands]: "
        'columns = ["out0", "out1", "out3", "out2", "out4", "out5", "out6", "out7"]'
    )
    assert found.headline().endswith(
        "put the columns of [commands] in the map in the order 1, 2, 4, 3, 5, 6, 7, 8"
    )


@pytest.mark.parametrize("scale", [0.4, 2.0])
def test_a_common_scale_is_no_matter_of_single_thrusters(log, scale):
    vehicle = damped()
    weaker = tuple(
        msgspec.structs.replace(
            one, max_thrust=one.max_thrust / scale, max_reverse_thrust=one.max_thrust / scale
        )
        for one in vehicle.thruster
    )
    found = audited(log, msgspec.structs.replace(vehicle, thruster=weaker))
    assert not found.wrong
    assert found.scale[1] < scale < found.scale[2]
    (line,) = found.statements()
    assert line.startswith(f"common factor: {found.scale[0]:.2f} times the thrust of the file")


def by_a_mixer(vehicle, *, seed=0, rows=2500):
    """A recording of demands in five axes that eight thrusters share: their thrusts depend on one another."""
    rng, t = np.random.default_rng(seed), np.arange(rows) * 0.02
    tau = np.zeros((rows, 6))
    for axis, size in enumerate([120.0, 120.0, 150.0, 10.0, 0.0, 30.0]):
        tau[:, axis] = size * np.sin(2 * np.pi * rng.uniform(0.05, 0.4) * t + rng.uniform(0, 6))
    thrust = allocate(configuration_matrix(vehicle), tau)
    ahead, astern = vehicle.thruster[0].max_thrust, vehicle.thruster[0].max_reverse_thrust
    commands = np.where(thrust > 0.0, thrust / ahead, thrust / astern)
    columns = {f"cmd_{i + 1}": column for i, column in enumerate(commands.T)}
    return simulate(vehicle, pl.DataFrame({"session": ["a"] * rows, "t": t} | columns))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("mounted", [True, False])
def test_a_reversed_thruster_whose_curve_is_not_symmetric(seed, mounted):
    """Mounted in reverse it gives -F(u), with a negated command F(-u): both are -1 times the file's."""
    known = damped()
    uneven = [msgspec.structs.replace(one, max_reverse_thrust=90.0) for one in known.thruster]
    known = msgspec.structs.replace(known, thruster=tuple(uneven))
    raw = noisy(by_a_mixer(known, seed=seed))
    assert not audited(raw, known).wrong
    if mounted:
        uneven[1] = msgspec.structs.replace(uneven[1], direction=tuple(-x for x in uneven[1].direction))
        known = msgspec.structs.replace(known, thruster=tuple(uneven))
    else:
        raw = raw.with_columns(-pl.col("cmd_2"))
    found = audited(raw, known)
    assert found.wiring.reversed == (1,)
    assert found.low[1] < -1.0 < found.high[1] < -0.5
    assert len(list(found.statements())) == 1


def test_a_dead_thruster_does_not_hide_a_reversed_one():
    gains = {"name": "thruster_gain", "g": [-1.0, 0, 0, 0, 0, 0, 0, 0]}
    raw = noisy(moved(damped(gains), rows=2500, seed=1)).with_columns(-pl.col("cmd_5"))
    found = audited(raw)
    assert found.wiring.reversed == (4,)
    assert not found.clear[0]
    assert any(line.startswith("thruster 1 hardly pushes") for line in found.lines())


def test_thrusters_that_always_act_together_are_named_and_nothing_is_said_of_one():
    """All vertical thrusters have one command: their sum shows, not one of them."""
    t = np.arange(3000) * 0.02
    columns = {"session": ["a"] * len(t), "t": t}
    rng = np.random.default_rng(3)
    for i in range(4):
        columns[f"cmd_{i + 1}"] = 0.6 * np.sin(2 * np.pi * rng.uniform(0.05, 0.4) * t + rng.uniform(0, 6))
    for i in range(4, N):
        columns[f"cmd_{i + 1}"] = 0.4 * np.sin(0.9 * t)
    raw = noisy(simulate(damped(), pl.DataFrame(columns)))
    found = audited(raw)
    assert not found.wrong
    assert found.together == ((4, 5, 6, 7),)
    assert found.clear.tolist() == [True] * 4 + [False] * 4
    told = list(found.lines())
    assert told[0] == "thrusters 1 to 4 push as the file says"
    assert told[1].startswith("thrusters 5, 6, 7 and 8 act alike in this recording and cannot be separated")
    upside_down = audited(raw.with_columns(-pl.col(f"cmd_{i + 1}") for i in range(4, N)))
    assert upside_down.wrong
    assert upside_down.wiring.is_plain, "nothing is stated of one of them"


def test_a_thruster_that_did_not_run_is_not_judged():
    found = audited(noisy(moved(damped(), rows=2500, thrusters=range(7))))
    assert not found.wrong
    assert found.idle.tolist() == [False] * 7 + [True]
    assert "thruster 8 did not run: no result for it" in found.lines()


def test_only_the_accelerations_that_are_measured_are_used(log):
    """Attitude, rates and depth: what is not measured is named."""
    hidden = [*POSE[:2], *VELOCITY[:3]]
    raw = log.with_columns(pl.lit(None, pl.Float32).alias(name) for name in hidden)
    found = audited(drawn(raw, range(N), [1, 1, -1, 1, 1, 1, 1, 1]))
    assert found.shown.tolist() == [False] * 3 + [True] * 3
    assert found.wiring.reversed in ((2,), ())
    assert list(found.lines())[-1].startswith("accelerations of u, v and w are not measured")


def test_a_log_without_motion_says_nothing():
    """Commands that move nothing, as on a bench."""
    raw = moved(damped(), rows=2500)
    still = {name: pl.lit(0.0) for name in (*POSE, *VELOCITY)}
    found = audited(noisy(raw.with_columns(**still)))
    assert found is None or not found.wrong


def test_pieces_of_a_quarter_of_a_minute_raise_no_alarm(log):
    """With few windows the regression has as many terms as windows, so its errors look far too small."""
    t = log["t"] - log["t"][0]
    pieces = [log.filter((t >= 5.0 * k) & (t < 5.0 * k + 15.0)) for k in range(8)]
    found = [audited(piece) for piece in pieces]
    assert all(one is not None for one in found)
    assert not any(one.wrong for one in found if one is not None)


def test_a_recording_too_short_for_it_says_nothing(log):
    raw = drawn(log, [1, 0, *range(2, N)], [1] * N).head(200)
    assert audited(raw) is None


def test_a_vehicle_without_thrusters_is_no_matter(log):
    bare = msgspec.structs.replace(synthetic.vehicle(), thruster=())
    raw = log.drop([f"cmd_{i + 1}" for i in range(N)])
    assert audited(raw, bare) is None


def by_demands(coupling, *, rows=4000, seed=0):
    """A file with a thruster or a couple of two for each axis, and a recording of demands in six axes.

    The vehicle has another mixer than the file: the demand of pitch pushes it up as well, by `coupling` times
    the thrust of one thruster, and its inertia in pitch is three times the file's.
    """
    known, kind = damped(), type(synthetic.vehicle().thruster[0])
    pushes = [("X", 0, 0), ("Y", 1, 0), ("Z", 2, 0)]
    pairs = [("K", 1, 2, 1.0), ("M", 0, 2, -1.0), ("N", 0, 1, 1.0)]
    axes = np.eye(3)
    file = [kind(name=name, position=(0.0, 0.0, 0.0), direction=tuple(axes[a])) for name, a, _ in pushes]
    for name, arm, along, sign in pairs:
        for end in (1.0, -1.0):
            place, direction = tuple(end * axes[arm]), tuple(end * sign * axes[along])
            file.append(kind(name=f"{name}{end:+.0f}", position=place, direction=direction))
    file = [
        msgspec.structs.replace(one, max_thrust=size, max_reverse_thrust=size, curve="linear")
        for one, size in zip(file, [60.0] * 3 + [15.0] * 6, strict=True)
    ]
    given_file = msgspec.structs.replace(known, thruster=tuple(file))
    up = msgspec.structs.replace(
        file[5],
        name="up",
        position=(0.0, 0.0, 0.0),
        direction=(0.0, 0.0, -1.0),
        max_thrust=15.0 * coupling,
        max_reverse_thrust=15.0 * coupling,
    )
    inertia = np.array(known.rigid_body.inertia)
    inertia[1, 1] *= 3.0
    body = msgspec.structs.replace(known.rigid_body, inertia=inertia.tolist())
    actual = msgspec.structs.replace(known, rigid_body=body, thruster=(*file, up))
    rng, t = np.random.default_rng(seed), np.arange(rows) * 0.02
    wave = [
        size * np.sin(2 * np.pi * rng.uniform(0.05, 0.4) * t + rng.uniform(0, 6))
        for size in (0.5, 0.5, 0.5, 0.3, 0.3, 0.3)
    ]
    of = [0, 1, 2, 3, 3, 4, 4, 5, 5, 4]
    columns = {f"cmd_{i + 1}": wave[axis] for i, axis in enumerate(of)}
    raw = simulate(actual, pl.DataFrame({"session": ["a"] * rows, "t": t} | columns))
    return given_file, noisy(raw.drop("cmd_10"))


@pytest.mark.parametrize("seed", range(2))
def test_a_mixer_that_the_file_does_not_know_is_no_reversed_thruster(seed):
    """The pitch demand pushes up as well; it still pitches the vehicle as the file says."""
    known, raw = by_demands(4.0, seed=seed)
    assert not audited(raw, known).wrong


def regressed(arms, gram, score) -> Balance:
    """Statistics of a regression in which all thrusters have one curve and ran, and all axes are measured."""
    count = arms.shape[1]
    every, none = np.ones(6, bool), np.zeros(count, bool)
    kinds, driven = np.zeros(count, np.int64), np.arange(count)
    return Balance(gram, score, arms, kinds, every, ~every, np.zeros(6), driven, none, 0.0)


def pushing(strengths, information=100.0) -> Balance:
    """Statistics that show these effectivenesses of thrusters along x, y, z and about them, to 0.1."""
    count = len(strengths)
    arms, gram = np.eye(6)[:, :count], np.zeros((6, count, count))
    for axis in range(count):
        gram[axis] = information * np.eye(count)
    return regressed(arms, gram, gram @ np.zeros(count) + information * arms * np.array(strengths))


def claimed(found: Balance, *chances) -> list:
    """What stands of hypotheses with these probabilities, the likeliest first."""
    tried = SimpleNamespace(wirings=lambda: list(chances))
    return thrusters._explaining(found, cast(Any, tried))


def test_an_exchange_that_leaves_the_thrusters_as_unequal_counts_for_the_file(monkeypatch):
    """Estimates of a log whose file has too little added mass in heave, in both orders."""
    strengths = {
        (0, 1, 2, 3, 4, 5): [0.60, 0.51, 0.72, 0.75, 0.12, 0.10],
        (2, 1, 0, 3, 4, 5): [2.35, 3.02, 2.85, 3.48, 0.12, 0.10],
    }
    monkeypatch.setattr(
        thrusters, "effectiveness", lambda _, column: (np.array(strengths[column]), 0.01 * np.eye(6))
    )
    swapped, file = Wiring((2, 1, 0, 3, 4, 5), (1,) * 6), Wiring.plain(6)
    assert claimed(cast(Any, None), (swapped, 0.75), (file, 0.25)) == [(file, 1.0)]


def test_a_reversed_thruster_stands_without_an_exchange_beside_it():
    found = pushing([0.8, -0.8, 0.7, 0.8])
    turned = Wiring((0, 1, 2, 3), (1, -1, 1, 1))
    both = Wiring((2, 1, 0, 3), (1, -1, 1, 1))
    assert claimed(found, (both, 0.9), (turned, 0.1)) == [(turned, pytest.approx(1.0))]


def test_an_assignment_has_simpler_ones():
    turned = Wiring((1, 2, 0, 3), (1, 1, 1, -1))
    assert set(turned.simpler()) == {
        Wiring((1, 2, 0, 3), (1, 1, 1, 1)),
        Wiring((0, 2, 1, 3), (1, 1, 1, -1)),
        Wiring((2, 1, 0, 3), (1, 1, 1, -1)),
        Wiring((1, 0, 2, 3), (1, 1, 1, -1)),
    }
    assert not list(Wiring.plain(3).simpler())


def test_thrusters_are_weak_only_beside_others_of_their_axis():
    """All thrusters along one axis at 0.3 may push a heavier vehicle; one of them at 0.3 does not."""
    arms = np.zeros((6, 4))
    arms[0, :2] = arms[2, 2:] = 1.0
    gram = np.stack([100.0 * np.diag(row) for row in arms])
    found, seen = regressed(arms, gram, np.zeros((6, 4))), np.ones(4, bool)
    assert not thrusters._weak(found, np.array([1.0, 1.0, 0.3, 0.3]), seen, 1.0).any()
    assert thrusters._weak(found, np.array([1.0, 1.0, 1.0, 0.3]), seen, 1.0).tolist() == [False] * 3 + [True]
    dead = thrusters._weak(found, np.array([1.0, 1.0, 0.1, 0.1]), seen, 1.0)
    assert dead.tolist() == [False, False, True, True], "no error of the inertia explains this"
