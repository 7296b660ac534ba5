"""The check of frames and signs names what is wrong, is quiet on what is right, and says where it is void."""

from __future__ import annotations

from dataclasses import replace

import logs
import msgspec
import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hydro.core.logs.alternatives import flips
from hydro.core.logs.convention_check import Verdict, check
from hydro.core.logs.conventions import SessionLog
from hydro.core.logs.importing import raw_table
from hydro.core.logs.logmap import LogMap

TRUE = logs.Convention()


def verdict(log: pl.DataFrame, spec: dict) -> Verdict:
    declared = msgspec.convert(spec, LogMap)
    numbers = {key: log[key].to_numpy() for key in log.columns if log[key].dtype.is_numeric()}
    made = raw_table([SessionLog("dive", numbers["clock"] - numbers["clock"][0], numbers)], declared)
    return check(made.logs, made.times, made.dt, declared)


def judged(how: logs.Convention, believed: logs.Convention | None = None, **motion) -> Verdict:
    """The verdict on a log written one way with ordinary noise, and read another."""
    raw = logs.raw(**({"seconds": 40.0, "rate": 20.0, "noise": logs.ORDINARY} | motion))
    log, _ = logs.written(raw, how)
    return verdict(log, logs.written(raw, believed or how)[1])


@given(logs.conventions, st.integers(0, 10_000))
@settings(max_examples=15)
def test_it_is_quiet_on_every_right_declaration_at_ordinary_noise(how, seed):
    found = judged(replace(how, time="s"), seed=seed)
    assert found.contradictions == ()
    assert not [note for note in found.notes if "back" in note or "disagrees" in note or "negative" in note]
    assert found.agreement[0] < 0.06
    assert found.agreement[1] < 0.006


@pytest.mark.parametrize("still", [(1, 2), (0, 1, 2), (3, 4), (1, 2, 3, 4, 5), (0, 1, 2, 3, 4, 5)])
@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_it_is_quiet_on_a_vehicle_that_hardly_moves(still, noise):
    found = judged(TRUE, still=still, noise=noise * logs.ORDINARY)
    assert found.contradictions == ()
    assert not any("mends" in note for note in found.notes)


WRONG = [
    (TRUE, {"velocity": "FLU"}, {"velocity.frame": "FRD"}),
    (TRUE, {"velocity": "NED"}, {"velocity.frame": "FRD"}),
    (replace(TRUE, velocity="ENU"), {"velocity": "FRD"}, {"velocity.frame": "ENU"}),
    (replace(TRUE, velocity="NED"), {"velocity": "ENU"}, {"velocity.frame": "NED"}),
    (TRUE, {"rates": "FLU"}, {"rates.frame": "FRD"}),
    (TRUE, {"turn": "deg/s"}, {"rates.unit": "rad/s"}),
    (replace(TRUE, turn="deg/s"), {"turn": "rad/s"}, {"rates.unit": "deg/s"}),
    (TRUE, {"position": "ENU"}, {"position.world": "NED"}),
    (replace(TRUE, position="ENU"), {"position": "NED"}, {"position.world": "ENU"}),
    (replace(TRUE, position="NWU"), {"position": "ENU"}, {"position.world": "NWU"}),
    (TRUE, {"attitude": ("NED", "FLU")}, {"attitude.body": "FRD"}),
    (TRUE, {"attitude": ("ENU", "FRD")}, {"attitude.world": "NED"}),
    (logs.ROS, {"attitude": ("NED", "FRD")}, {"attitude.world": "ENU", "attitude.body": "FLU"}),
    (replace(TRUE, angles="deg"), {"angles": "rad"}, {"attitude.unit": "deg"}),
    (TRUE, {"angles": "deg"}, {"attitude.unit": "rad"}),
    (TRUE, {"angles": "XYZ"}, {"attitude.order": "ZYX"}),
    (replace(TRUE, angles="wxyz"), {"angles": "inverse"}, {"attitude.turns": "body to world"}),
    (TRUE, {"velocity": "FLU", "rates": "FLU", "position": "NWU"},
     {"velocity.frame": "FRD", "rates.frame": "FRD", "position.world": "NED"}),
    (replace(TRUE, position="ENU"), {"position": "NED", "velocity": "FLU"},
     {"position.world": "ENU", "velocity.frame": "FRD"}),
]  # fmt: skip


@pytest.mark.parametrize(("how", "belief", "advice"), WRONG, ids=lambda value: str(value)[:60])
def test_it_names_each_wrong_declaration_and_nothing_else(how, belief, advice):
    found = judged(how, replace(how, **belief))
    advised = " ".join(found.contradictions)
    for path, value in advice.items():
        assert f'{path} = "{value}"' in advised
    assert advised.count(' = "') == len(advice)
    assert check_of_advice(how, found)


def check_of_advice(how: logs.Convention, found: Verdict) -> bool:
    """Whether the log read as advised is the log as it was written."""
    raw = logs.raw(4.0, 20.0)
    log, spec = logs.written(raw, how)
    numbers = {key: log[key].to_numpy() for key in log.columns if log[key].dtype.is_numeric()}
    session = SessionLog("dive", numbers["clock"] - numbers["clock"][0], numbers)
    right, advised = (
        raw_table([session], meaning).frame for meaning in (msgspec.convert(spec, LogMap), found.follows)
    )
    return right.drop("session").to_numpy() == pytest.approx(advised.drop("session").to_numpy(), abs=1e-9)


def test_a_line_tells_declared_and_found_their_errors_and_the_remedy():
    (line,) = judged(replace(TRUE, velocity="FLU"), TRUE).contradictions
    assert line.startswith("velocity looks FLU, not FRD as declared: d(position)/dt agrees to 0.0")
    assert line.endswith('; set velocity.frame = "FLU"')
    best, declared = (float(word) for word in line.split() if word.startswith(("0.", "1.")))
    assert best < 0.06
    assert declared > 0.8


@pytest.mark.parametrize("number", range(12))
def test_it_names_a_reversed_column_and_how_to_write_it(number):
    raw = logs.raw(40.0, 20.0, logs.ORDINARY)
    log, spec = logs.written(raw, TRUE)
    column = ["east", "north", "up", "roll", "pitch", "heading", "v1", "v2", "v3", "g1", "g2", "g3"][number]
    found = verdict(log.with_columns(-pl.col(column)), spec)
    (line,) = found.contradictions
    assert f"column {column} looks reversed" in line
    assert f'{{column = "{column}", scale = -1}}' in line


@pytest.mark.parametrize(("first", "second"), [("v1", "v2"), ("v2", "v3"), ("g1", "g3"), ("roll", "pitch")])
def test_it_names_two_exchanged_columns_and_how_to_write_them(first, second):
    log, spec = logs.written(logs.raw(40.0, 20.0, logs.ORDINARY), TRUE)
    swapped = log.with_columns(pl.col(first).alias(second), pl.col(second).alias(first))
    (line,) = verdict(swapped, spec).contradictions
    assert f"columns {first} and {second} look exchanged" in line
    assert f"write {second} in the place of {first}" in line


def test_two_columns_reversed_together_are_found_where_neither_alone_makes_it_better():
    log, spec = logs.written(logs.raw(40.0, 20.0, logs.ORDINARY), TRUE)
    told = " ".join(verdict(log.with_columns(-pl.col("up"), -pl.col("v3")), spec).contradictions)
    assert "column up looks reversed" in told
    assert "column v3 looks reversed" in told


def test_a_reversed_axis_is_found_beside_much_larger_motion_on_the_others():
    rng = np.random.default_rng(2)
    raw = logs.raw(60.0, 20.0)
    calm = raw.with_columns(v=pl.col("v") * 0.0)
    t = raw["t"].to_numpy()
    sway = 0.08 * np.sin(0.7 * t)
    R = raw.select("phi", "theta", "psi").to_numpy()
    from scipy.integrate import cumulative_trapezoid
    from scipy.spatial.transform import Rotation

    body = np.column_stack([raw["u"], sway, raw["w"]])
    world = Rotation.from_euler("ZYX", R[:, ::-1]).apply(body)
    placed = (
        cumulative_trapezoid(world, t, axis=0, initial=0.0) + 10.0 + 0.02 * rng.standard_normal((len(t), 3))
    )
    made = calm.with_columns(
        x=placed[:, 0], y=placed[:, 1], z=placed[:, 2], v=-sway + 0.01 * rng.standard_normal(len(t))
    )
    found = verdict(*logs.written(made, TRUE))
    (line,) = found.contradictions
    assert "column v2 looks reversed" in line


def test_axes_without_motion_are_called_untested():
    found = judged(TRUE, still=(1, 2, 3, 4, 5))
    (note,) = found.notes
    assert note == "too little motion to test the sign of v3, g1, g2, g3"


@pytest.mark.parametrize("rule", ["euler", "trapezoid"])
def test_a_pose_made_of_the_same_velocities_is_told(rule):
    from scipy.spatial.transform import Rotation

    raw = logs.raw(60.0, 50.0, logs.ORDINARY)
    body = raw.select("u", "v", "w").to_numpy()
    world = Rotation.from_euler("ZYX", raw.select("psi", "theta", "phi").to_numpy()).apply(body)
    step = world[:-1] if rule == "euler" else 0.5 * (world[1:] + world[:-1])
    placed = np.vstack([np.zeros(3), np.cumsum(step * 0.02, axis=0)]) + 30.0
    made = raw.with_columns(x=placed[:, 0], y=placed[:, 1], z=placed[:, 2])
    found = verdict(*logs.written(made, TRUE))
    assert found.contradictions == ()
    assert any("position agrees with the velocity better than the noise" in note for note in found.notes)
    assert not any("position agrees" in note for note in verdict(*logs.written(raw, TRUE)).notes)


def test_up_for_down_throughout_shows_in_the_depth_alone():
    found = judged(
        logs.ROS, replace(logs.ROS, position="NED", attitude=("NED", "FRD"), velocity="FRD", rates="FRD")
    )
    assert found.contradictions == ()
    assert any("the depth is negative in 100 %" in note for note in found.notes)


def test_a_vehicle_on_its_back_is_remarked():
    upside = replace(TRUE, attitude=("NED", "FLU"), velocity="FLU", rates="FLU")
    found = judged(TRUE, upside)
    assert found.contradictions == ()
    assert any("vehicle is upside down" in note for note in found.notes)


def test_a_column_of_something_else_is_remarked_and_not_explained_away():
    rng = np.random.default_rng(0)
    raw = logs.raw(60.0, 20.0, logs.ORDINARY)
    other = raw.with_columns(
        *(pl.Series(name, np.cumsum(rng.standard_normal(raw.height)) * 0.1) for name in "uvw")
    )
    found = verdict(*logs.written(other, TRUE))
    assert found.contradictions == ()
    assert any("no choice of frames, units and signs removes it" in note for note in found.notes)


def test_a_short_log_is_not_tested():
    found = judged(TRUE, replace(TRUE, velocity="FLU"), seconds=4.0)
    assert found.contradictions == ()
    assert found.notes == ("frames and signs not tested: there are not 6 windows of 1 s without a gap",)
    assert np.isnan(found.agreement).all()


def test_a_depth_gauge_that_counts_upward_is_found():
    raw = logs.raw(40.0, 20.0, logs.ORDINARY)
    log, spec = logs.written(raw, replace(TRUE, depth="depth"))
    found = verdict(log.with_columns(-pl.col("up")), spec)
    (line,) = found.contradictions
    assert "column up looks reversed" in line


def test_every_measured_column_is_tried_reversed():
    declared = msgspec.convert(logs.written(logs.raw(1.0), replace(TRUE, depth="depth"))[1], LogMap)
    assert len(flips(declared)) == 12


def test_an_attitude_that_does_not_follow_the_rates_gets_one_verdict():
    """It neither agrees, nor moves too little to test a sign; and no velocity was logged."""
    t = np.arange(1200) * 0.05
    rng = np.random.default_rng(1)
    walk = np.cumsum(rng.standard_normal((3, 1200)), axis=1) * [[0.15], [0.05], [0.15]]
    columns = dict(zip(["phi", "theta", "psi"], (walk + np.pi) % (2 * np.pi) - np.pi, strict=True))
    columns |= {
        "p": 1.5 * np.sin(t),
        "q": 1.7 * np.sin(1.3 * t),
        "r": 0.8 * np.sin(0.6 * t),
        "cmd_1": 0.0 * t,
    }
    meaning = msgspec.structs.replace(logs.PLAIN, position=None, velocity=None)
    verdict = check([SessionLog("a", t, columns)], [t], 0.05, meaning)
    assert verdict.disagree == (False, True)
    (note,) = verdict.notes
    assert "disagrees with the logged rates" in note
