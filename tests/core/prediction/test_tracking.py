"""Motion that no sensor gives, from the commands and a model: near the truth, and good enough to fit from."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import damped, moved, noisy

from hydro.core.columns import POSE, VELOCITY
from hydro.core.identification.fit import fit
from hydro.core.prediction.tracking import BLIND_SECONDS, LEAST_ROOM, shot_seconds, tracked
from hydro.core.prediction.visibility import not_shown
from hydro.core.prediction.weak_form import Windows
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import SHOT_SECONDS

DEPTH_AND_ATTITUDE = ("z", "phi", "theta", "psi")
TURN = 2.0  # rad that the whole world is turned by, so that the first heading is not the one to guess


def only(raw: pl.DataFrame, *names: str) -> pl.DataFrame:
    rest = [name for name in (*POSE, *VELOCITY) if name not in names]
    return raw.with_columns(pl.lit(None, pl.Float64).alias(name) for name in rest)


def wrong(share: float):
    """The vehicle with another damping than it has."""
    tables = [
        table | {"diagonal": (share * np.array(table["diagonal"])).tolist()}
        if "damping" in table["name"]
        else table
        for table in damped().effect
    ]
    return msgspec.structs.replace(damped(), effect=tuple(tables))


@pytest.fixture(scope="module")
def flown() -> pl.DataFrame:
    return noisy(moved(damped(), rows=3000), 0)


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    return moved(damped(), rows=3000).select(*POSE, *VELOCITY).to_numpy()


@pytest.mark.parametrize(("share", "within"), [(1.0, 0.02), (0.8, 0.1)])
def test_surge_and_sway_follow_from_depth_attitude_and_commands(flown, truth, share, within):
    record = recording(wrong(share), only(flown, *DEPTH_AND_ATTITUDE))
    found = tracked(wrong(share), record)
    off = np.sqrt(((found.nu - truth[:, 6:]) ** 2).mean(axis=0))
    before = np.sqrt(((record.nu - truth[:, 6:]) ** 2).mean(axis=0))
    assert (off[:3] < within).all()
    assert (off[:2] < 0.5 * before[:2]).all()
    assert (found.doubt[6:9] > 0.3 * off[:3] * share).all()
    np.testing.assert_array_equal(found.eta[:, 2:], record.eta[:, 2:])


@pytest.mark.parametrize("share", [0.3, 3.0])
def test_what_a_wrong_model_fills_is_known_to_be_doubtful(flown, truth, share):
    found = tracked(wrong(share), recording(wrong(share), only(flown, "z", "p", "q", "r")))
    off = np.sqrt(((found.nu - truth[:, 6:]) ** 2).mean(axis=0))[:3]
    assert (found.doubt[6:9] > 0.15 * off).all()  # rates and depth tell little of surge and sway
    assert np.abs(found.nu[:, :3]).max() < 5.0


def test_heading_follows_from_position_and_commands(flown, truth):
    c, s = np.cos(TURN), np.sin(TURN)
    turned = flown.with_columns(x=c * pl.col("x") - s * pl.col("y"), y=s * pl.col("x") + c * pl.col("y"))
    found = tracked(damped(), recording(damped(), only(turned, "x", "y", "z")))
    off = np.angle(np.exp(1j * (found.eta[:, 3:] - truth[:, 3:6] - [0.0, 0.0, TURN])))
    assert np.sqrt((off**2).mean(axis=0)).max() < 0.1


def test_where_all_is_seen_nothing_is_made_of_the_model(flown):
    whole = recording(damped(), flown)
    assert tracked(damped(), whole) is whole
    slopes = recording(damped(), only(flown, *POSE))
    assert tracked(damped(), slopes) is slopes
    assert shot_seconds(whole) == shot_seconds(slopes) < shot_seconds(recording(damped(), only(flown, "z")))


@pytest.mark.parametrize("names", [DEPTH_AND_ATTITUDE, (*DEPTH_AND_ATTITUDE, "u", "v", "w"), ("x", "y", "z")])
def test_a_fit_recovers_damping_from_what_there_is(flown, names):
    found = fit(wrong(0.8), only(flown, *names), ["linear_damping", "quadratic_damping"])
    true = np.concatenate([synthetic.LINEAR, synthetic.QUADRATIC])
    off = np.abs(found.values - true) / found.standard_errors
    assert (off[found.determined] < 3.5).all()
    assert found.determined.sum() >= 6
    assert found.chi2 == pytest.approx(1.0, abs=0.1)


def test_equation_error_counts_no_balance_that_was_filled_in(flown):
    record = recording(damped(), only(flown, *DEPTH_AND_ATTITUDE))
    windows = Windows.of(tracked(damped(), record))
    assert not windows.residuals(damped())[:, [0, 1, 2, 6, 7, 8]].any()
    assert windows.shown.tolist() == [False] * 3 + [True] * 3


def test_what_is_not_shown_is_told_sensor_by_sensor(flown):
    position, velocity, rates, *_ = not_shown(damped(), only(flown, *DEPTH_AND_ATTITUDE))
    assert position == "no position (x, y): nothing shows north, east, nor what acts there alone"
    assert velocity.startswith("no velocity (u, v, w): the other sensors and the model give surge ± ")
    assert rates.startswith("no rates of turn (p, q, r): ")
    assert not_shown(damped(), flown) == ()


def placed(position: list[float], direction: list[float]):
    """The first thruster of the vehicle at another place, in another direction."""
    return msgspec.structs.replace(damped().thruster[0], position=position, direction=direction)


def test_thrusters_seen_on_one_axis_are_named(flown):
    """Without position and velocity, surge and sway show nothing; a vertical thruster shows on three axes."""
    layout = (
        placed([0.0, -0.2, 0.0], [1.0, 0.0, 0.0]),
        placed([0.0, 0.2, 0.0], [1.0, 0.0, 0.0]),
        placed([0.2, 0.1, 0.0], [0.0, 0.0, 1.0]),
        placed([0.0, 0.0, -0.1], [0.0, 1.0, 0.0]),
    )
    vehicle = msgspec.structs.replace(damped(), thruster=layout)
    raw = flown.drop("cmd_5", "cmd_6", "cmd_7", "cmd_8")
    *_, line = not_shown(vehicle, only(raw, "z", "p", "q", "r"))
    assert line.startswith("thruster 4 shows in roll alone, thrusters 1 and 2 show in yaw alone: ")
    *_, line = not_shown(vehicle, only(raw, "z", "u", "v", "w", "p", "q", "r"))
    assert line.startswith("no attitude")


@pytest.mark.parametrize("dt", [0.005, 0.02, 0.2])
def test_shots_are_longer_where_a_recording_has_room_for_them_in_seconds(dt):
    """Whatever its sample time; no attitude or velocity was measured."""
    lengths = []
    for seconds in (0.9 * LEAST_ROOM * BLIND_SECONDS, 1.1 * LEAST_ROOM * BLIND_SECONDS):
        rows = round(seconds / dt)
        seen = np.zeros((rows, 12), bool)
        record = SimpleNamespace(seen=seen, segments=np.array([[0, rows]]), dt=dt)
        lengths.append(shot_seconds(cast(Any, record)))
    assert lengths == [SHOT_SECONDS, BLIND_SECONDS]
