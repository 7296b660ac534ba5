"""Columns that are not what they are called, in the log of a tumbling body and of a vehicle."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import damped, log, moved, noisy, spoilt

from hydro.core.cleaning.cleaned import cleaned
from hydro.core.columns import POSE, VELOCITY
from hydro.core.errors import DataError

VEHICLE = synthetic.vehicle()
ANGLES, RATES = POSE[3:], VELOCITY[3:]


def reverse(*names):
    return lambda raw: raw.with_columns(-pl.col(name) for name in names)


def exchange(first, second):
    return lambda raw: raw.with_columns(pl.col(first).alias(second), pl.col(second).alias(first))


def scale(names, factor):
    return lambda raw: raw.with_columns(pl.col(name) * factor for name in names)


DEGREES = 180.0 / np.pi
WRONG = [
    *((reverse(name), {name}) for name in ("x", "z", *ANGLES, *VELOCITY)),
    (reverse("v", "w"), {"u", "v", "w"}),
    (reverse("z", "w"), {"z", "w"}),
    (reverse("phi", "theta"), {"phi", "theta"}),
    (exchange("x", "y"), {"x", "y"}),
    (exchange("u", "v"), {"u", "v"}),
    (exchange("p", "q"), {"p", "q"}),
    (lambda raw: reverse("z")(exchange("x", "y")(raw)), {"x", "y", "z"}),
    (reverse("q", "r"), {"p", "q", "r"}),
    (scale(ANGLES, DEGREES), {"phi", "theta", "psi"}),
    (scale(RATES, DEGREES), {"p", "q", "r"}),
]


@pytest.fixture(scope="module")
def vehicle_log():
    raw = noisy(moved(damped(), rows=2500), 0)
    return raw.with_columns(pl.col("z") + 10.0 - pl.col("z").min())


@pytest.mark.parametrize(("spoil", "columns"), WRONG)
def test_columns_that_mean_something_else_are_told_and_put_right(spoil, columns):
    raw = log().head(2000)
    found = cleaned(VEHICLE, spoil(raw))
    assert {name for fault in found.faults for name in fault.columns} == columns
    told = found.raw.select(*POSE, *VELOCITY).to_numpy()
    true = raw.select(*POSE, *VELOCITY).to_numpy()
    away = told - true
    away[:, 3:6] = np.angle(np.exp(1j * away[:, 3:6]))
    assert np.abs(away).max() < 1e-9
    assert all("import" in fault.message for fault in found.faults)


@pytest.mark.parametrize(("spoil", "columns"), [WRONG[i] for i in (2, 6, 7, 13, 15, 18, 19)])
def test_so_they_are_in_the_log_of_a_vehicle(vehicle_log, spoil, columns):
    found = cleaned(damped(), spoil(vehicle_log))
    assert {name for fault in found.faults for name in fault.columns} == columns


@pytest.mark.parametrize("seed", range(3))
def test_a_sound_log_is_left_alone(seed):
    assert cleaned(VEHICLE, log(seed=seed)).raw.equals(log(seed=seed))
    raw = noisy(moved(damped(), seed=seed), seed)
    assert cleaned(damped(), raw).raw.equals(raw)


def level(depth: float, noise: bool = True) -> pl.DataFrame:
    """A body that keeps level and heads north, going up and down, with ordinary noise or none."""
    t = np.arange(3000) * 0.02
    u, v, w = 0.4 * np.sin(0.4 * t), 0.3 * np.sin(0.5 * t), 0.28 * np.sin(0.7 * t)
    x, y, z = -np.cos(0.4 * t), -0.6 * np.cos(0.5 * t), depth - 0.4 * np.cos(0.7 * t)
    moving = {"x": x, "y": y, "z": z, "u": u, "v": v, "w": w}
    columns = {"session": ["a"] * 3000, "t": t} | dict.fromkeys((*POSE, *VELOCITY), 0.0 * t) | moving
    raw = pl.DataFrame(columns | {f"cmd_{i + 1}": 0.0 * t for i in range(8)})
    return noisy(raw, 0) if noise else raw


def test_depth_tells_whether_z_or_w_is_reversed_where_the_vehicle_keeps_level():
    raw = level(depth=5.0)
    assert not cleaned(VEHICLE, raw).faults
    for name in ("z", "w"):
        (fault,) = cleaned(VEHICLE, reverse(name)(raw)).faults
        assert fault.columns == (name,)


def test_where_depth_does_not_tell_the_diagnosis_stops_and_names_both():
    with pytest.raises(DataError, match=r"does not show which.*import it") as told:
        cleaned(VEHICLE, reverse("w")(level(depth=0.0)))
    assert "column w" in str(told.value)
    assert "column z" in str(told.value)


@pytest.mark.parametrize("name", VELOCITY)
def test_a_velocity_that_was_never_measured_stops_the_diagnosis(name):
    raw = log()
    with pytest.raises(DataError, match=f"^{name} is 0.1 .* in every row.*import"):
        cleaned(VEHICLE, spoilt(raw, **{name: np.full(raw.height, 0.1)}))


@pytest.mark.parametrize(("speed", "moves"), [(0.02, False), (0.04, True)])
def test_a_sway_of_zero_is_contradicted_by_a_pose_that_moves_sideways(speed, moves):
    """From three centimetres per second: less may be a drift of the pose."""
    raw = level(depth=5.0, noise=False)
    t = raw["t"].to_numpy()
    beside = spoilt(raw, y=speed * np.sqrt(2.0) / 0.1 * np.sin(0.1 * t), v=np.zeros(raw.height))
    if moves:
        with pytest.raises(DataError, match=r"^v is 0 m/s in every row, while the pose changes"):
            cleaned(VEHICLE, beside)
    else:
        assert not cleaned(VEHICLE, beside).faults


def test_velocities_of_axes_along_which_nothing_moves_may_be_zero():
    raw = level(depth=5.0)
    zero = {name: np.zeros(raw.height) for name in ("p", "q", "r")}
    assert not cleaned(VEHICLE, spoilt(raw, **zero)).faults


def test_a_log_without_velocities_has_nothing_to_hold_its_columns_to():
    raw = log().with_columns(pl.lit(None, pl.Float64).alias(name) for name in ("u", "v", "w"))
    assert not cleaned(VEHICLE, raw).faults
