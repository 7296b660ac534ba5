"""Simple predictors against their own equations, and frozen weights: a step must not move the yardstick."""

from __future__ import annotations

from typing import Any, cast

import msgspec
import numpy as np
import polars as pl
import pytest
import synthetic
from scipy.integrate import solve_ivp

from hydro.core.columns import POSE, VELOCITY
from hydro.core.evaluation.compare import compare
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.evaluation.yardsticks import (
    CONSTANT,
    LEAST_SQUARES,
    ZERO,
    Damped,
    Yardstick,
    lost,
    march,
    reason,
)
from hydro.core.explanation.ladder import HORIZON
from hydro.core.recording.arrays import recording
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.thrusters import configuration_matrix

DT = 0.02
SURGE = {"linear": -0.3, "quadratic": -0.8, "delay": 0.3}
MASS = 200.0


def heavier(times: float):
    """The synthetic vehicle with its added mass multiplied."""
    known = synthetic.vehicle()
    added = {"name": "added_mass", "diagonal": (times * np.array(synthetic.ADDED)).tolist()}
    return msgspec.structs.replace(known, effect=(added,))


def flown(rows: int = 1500) -> pl.DataFrame:
    t, rng = np.arange(rows) * DT, np.random.default_rng(3)
    columns = {"session": ["a"] * rows, "t": t}
    columns |= {f"cmd_{i}": 0.5 * np.sin(rng.uniform(0.4, 1.5) * t + i) for i in range(1, 9)}
    return simulate(heavier(1.0), pl.DataFrame(columns))


def surging(rows: int = 6000) -> pl.DataFrame:
    """A recording whose surge obeys damping and delayed thrust exactly, and whose yaw never changes."""
    t = np.arange(rows) * DT
    command = np.sign(np.sin(0.5 * t)) * np.abs(np.sin(0.23 * t))
    vehicle = synthetic.vehicle()
    B = configuration_matrix(vehicle)
    horizontal = np.sign(B[0, :4])

    def thrust(at: float) -> float:
        return command[min(max(round((at - SURGE["delay"]) / DT - 0.499), 0), rows - 1)]

    gain = float(np.abs(B[0, :4]).sum()) * synthetic.MAX_THRUST

    def rate(at: float, nu: np.ndarray) -> np.ndarray:
        force = gain * thrust(at) / MASS
        return SURGE["linear"] * nu + SURGE["quadratic"] * np.abs(nu) * nu + force

    u = solve_ivp(rate, (0.0, t[-1]), [0.0], t_eval=t, max_step=DT, rtol=1e-6).y[0]
    still = {name: np.zeros(rows) for name in (*POSE, *VELOCITY)} | {"u": u, "x": np.cumsum(u) * DT}
    still["r"] = np.full(rows, 0.2)
    commands = {f"cmd_{i + 1}": command * horizontal[i] if i < 4 else np.zeros(rows) for i in range(8)}
    return pl.DataFrame({"session": ["a"] * rows, "t": t, **still, **commands})


def without_lag():
    known = synthetic.vehicle()
    prompt = tuple(msgspec.structs.replace(one, time_constant=0.0) for one in known.thruster)
    return msgspec.structs.replace(known, thruster=prompt)


def weights(comparison: pl.DataFrame, level: str) -> dict[str, float]:
    rows = comparison.filter(pl.col("weight").is_not_null(), level=level)
    return dict(rows.select("axis", "weight").unique().iter_rows())


# Weights.


def test_a_step_that_changes_added_mass_changes_no_weight():
    raw, given = flown(), heavier(0.2)
    first = compare(given, raw)
    yardstick = Yardstick.of(given, raw)
    for other in (
        compare(heavier(3.0), raw, yardstick=yardstick),
        compare(heavier(3.0), raw, against=first),
        compare(heavier(1.0), raw, against=compare(heavier(3.0), raw, against=first)),
    ):
        for level in ("force", "replay", "yardstick"):
            assert weights(other, level) == weights(first, level)
    own = weights(compare(heavier(3.0), raw), "replay")
    assert own["u"] == pytest.approx((synthetic.MASS + 3.0 * synthetic.ADDED[0]) / synthetic.MASS)


def test_all_axes_together_are_the_weighted_squares_of_each():
    raw = flown()
    table = compare(heavier(3.0), raw, against=compare(heavier(0.2), raw))
    rows = table.filter(level="replay", by="all", horizon=HORIZON)
    each = rows.filter(pl.col("axis").is_in(VELOCITY))
    expected = np.sqrt((each["weight"] * each["rmse"] ** 2).sum())
    assert rows.filter(axis="all")["rmse"].item() == pytest.approx(expected)
    # A lower error on every axis is a lower error of all.
    better = compare(heavier(1.0), raw, against=table).filter(level="replay", by="all", horizon=HORIZON)
    assert (better.filter(pl.col("axis").is_in(VELOCITY))["rmse"] < each["rmse"]).all()
    assert better.filter(axis="all")["rmse"].item() < expected


# Predictors.


def test_least_squares_finds_damping_and_delay():
    raw, vehicle = surging(), without_lag()
    damped = Yardstick.of(vehicle, raw).damped[0]
    assert damped.delay == pytest.approx(SURGE["delay"])
    assert damped.linear == pytest.approx(SURGE["linear"], abs=0.06)
    assert damped.quadratic == pytest.approx(SURGE["quadratic"], rel=0.08)
    assert damped.thrust == pytest.approx(1.0 / MASS, rel=0.05)


def test_damping_never_drives_and_thrust_never_brakes():
    raw = flown()
    backwards = raw.with_columns(-pl.col(f"cmd_{i}") for i in range(1, 9))
    for one in Yardstick.of(heavier(1.0), backwards).damped:
        assert max(one.linear, one.quadratic) <= 0.0 <= one.thrust


def test_a_march_is_the_solution_of_its_equation():
    rng = np.random.default_rng(0)
    axes = [Damped(*row, 0.0) for row in rng.uniform([-2.0, -3.0, 0.5, -0.2], [0.0, 0.0, 2.0, 0.2], (4, 4))]
    first, tau = rng.uniform(-1.0, 1.0, (3, 4)), np.broadcast_to(rng.uniform(-1, 1, (3, 1, 4)), (3, 1001, 4))
    found = march(axes, first, tau, 0.005)
    for shot in range(3):
        for axis, one in enumerate(axes):
            force = one.thrust * tau[shot, 0, axis] + one.steady
            true = solve_ivp(
                lambda t, y, one=one, force=force: one.linear * y + one.quadratic * np.abs(y) * y + force,
                (0.0, 5.0),
                [first[shot, axis]],
                rtol=1e-9,
                atol=1e-9,
            )
            assert found[shot, -1, axis] == pytest.approx(true.y[0, -1], abs=2e-3)


def test_without_fits_that_leave_a_fold_out_the_one_fit_predicts_every_start():
    record, starts = recording(heavier(1.0), flown(400)), np.array([0, 150, 300])
    rows, first = starts[:, None] + np.arange(50), np.ones((3, 6))
    axes, tau = tuple(Damped(-0.5, 0.0, 0.0, 0.0, 0.0) for _ in range(6)), np.zeros((400, 6))
    one = Yardstick(heavier(1.0), cast(Any, None), axes)
    decay = one._by_least_squares(record, starts, rows, first, tau)
    np.testing.assert_allclose(decay[:, :, 0], np.tile(np.exp(-0.5 * DT * np.arange(50)), (3, 1)), rtol=1e-2)


def test_errors_of_the_predictors_are_those_of_their_words():
    raw, vehicle = surging(2000), without_lag()
    table = compare(vehicle, raw)
    length = round(HORIZON / DT) + 1
    shots = raw.head(len(raw) // length * length)["u"].to_numpy().reshape(-1, length)
    rows = table.filter(level="yardstick", horizon=HORIZON, axis="u")
    rmse = dict(rows.select("by", "rmse").iter_rows())
    assert rmse[ZERO] == pytest.approx(np.sqrt(np.mean(shots**2)), rel=1e-6)
    assert rmse[CONSTANT] == pytest.approx(np.sqrt(np.mean((shots - shots[:, :1]) ** 2)), rel=0.01)
    assert rmse[LEAST_SQUARES] < 0.25 * min(rmse[ZERO], rmse[CONSTANT])
    assert table.filter(level="yardstick")["horizon"].unique().sort().to_list() == [1.0, 5.0, 20.0]
    turning = table.filter(level="yardstick", horizon=HORIZON, axis="r", by=CONSTANT)["rmse"].item()
    assert turning < 1e-3, "yaw goes on as it went"


def test_who_is_beaten_is_told_by_the_best_that_beat_it():
    errors = pl.DataFrame(
        {
            "axis": ["u", "u", "r", "r", "q", "all"],
            "predictor": [ZERO, CONSTANT, ZERO, LEAST_SQUARES, ZERO, ZERO],
            "model": [1.0, 1.0, 0.5, 0.5, 1.0, 9.0],
            "simple": [0.9, 0.4, 0.6, 0.7, 0.995, 1.0],
        }
    )
    assert lost(errors) == [("u", CONSTANT)]


def coupled(rows: int = 6000) -> pl.DataFrame:
    """A recording whose surge obeys u' = -0.5 u + 0.4 r exactly, while the other axes swing as they like."""
    t, rng = np.arange(rows) * DT, np.random.default_rng(7)
    nu = np.stack([0.2 * np.sin(rng.uniform(0.2, 1.5) * t + rng.uniform(0, 6)) for _ in range(6)], axis=1)
    nu[:, 0] = 0.0
    for k in range(rows - 1):
        nu[k + 1, 0] = nu[k, 0] + DT * (-0.5 * nu[k, 0] + 0.4 * nu[k, 5])
    columns = {"session": ["a" if k < rows // 2 else "b" for k in range(rows)], "t": t}
    motion = dict(zip(VELOCITY, nu.T, strict=True)) | {name: np.zeros(rows) for name in POSE}
    return pl.DataFrame(columns | motion | {f"cmd_{i}": np.zeros(rows) for i in range(1, 9)})


def test_cross_terms_are_found_where_they_are_and_nowhere_else():
    surge = Yardstick.of(without_lag(), coupled()).damped[0]
    assert surge.cross[5] == pytest.approx(0.4, abs=0.04)
    assert np.abs(surge.cross[1:5]).max() < 0.04
    assert surge.linear == pytest.approx(-0.5, abs=0.05)


def test_motion_of_the_fitted_axes_does_not_grow_without_thrust():
    rng = np.random.default_rng(4)
    raw = coupled(2000)
    for _ in range(5):
        turned = np.linalg.qr(rng.standard_normal((6, 6)))[0]
        mixed = raw.select(VELOCITY).to_numpy() @ turned
        other = raw.with_columns(pl.Series(name, mixed[:, i]) for i, name in enumerate(VELOCITY))
        axes = Yardstick.of(without_lag(), other).damped
        last = march(axes, np.full((1, 6), 0.2), np.zeros((1, 3000, 6)), DT)[0, -1]
        rest = np.array([one.steady for one in axes])
        assert np.isfinite(last).all()
        assert np.abs(last).max() < 1.0 + 60.0 * np.abs(rest).max()


def test_sessions_are_predicted_by_fits_to_the_others():
    """What holds in one session alone does not help to predict it."""
    raw, vehicle = surging(6000), without_lag()
    raw = raw.with_columns(session=pl.Series(["a"] * 3000 + ["b"] * 3000))
    backwards = raw.with_columns(
        pl.when(pl.col("session") == "b")
        .then(-pl.col(f"cmd_{i}"))
        .otherwise(pl.col(f"cmd_{i}"))
        .alias(f"cmd_{i}")
        for i in range(1, 9)
    )
    record = recording(vehicle, backwards)
    crossed = Yardstick.crossed(vehicle, record)
    assert crossed.fold.tolist() == [0] * 3000 + [1] * 3000
    without_a, without_b = (fit[0].thrust for fit in crossed.left_out)
    assert without_a < 0.1 / MASS, "in b commands brake"
    assert without_b == pytest.approx(1.0 / MASS, rel=0.05)


def test_each_session_keeps_its_fit_in_any_order():
    """More sessions than folds, some shorter: groups are made by what the sessions are, not by their rows."""
    parts = [
        flown(400 + 20 * (k % 3)).with_columns(
            pl.lit(f"s{k}").alias("session"), pl.col("u") * (0.5 + 0.1 * k)
        )
        for k in range(7)
    ]

    def fits(order: list[int]) -> np.ndarray:
        crossed = Yardstick.crossed(heavier(1.0), recording(heavier(1.0), pl.concat(parts[k] for k in order)))
        first = np.cumsum([0, *(parts[k].height for k in order[:-1])])
        values = [crossed.left_out[fold][0][:5] for fold in crossed.fold[first]]
        return np.array(values)[np.argsort(order)]

    np.testing.assert_allclose(
        fits([0, 1, 2, 3, 4, 5, 6]), fits([5, 2, 6, 0, 4, 1, 3]), rtol=1e-7, atol=1e-10
    )


def test_the_reason_for_a_lead_is_the_part_that_lowers_the_residual_most():
    raw, vehicle = surging(), without_lag()
    record = recording(vehicle, raw)
    yardstick = Yardstick.fitted(vehicle, record)
    assert reason(yardstick, record, 0).startswith(("its delay of 0.3 s", "its command scale", "its damping"))
    record = recording(vehicle, coupled())
    assert reason(Yardstick.fitted(vehicle, record), record, 0).startswith("its cross terms with")


# What noise does.


def test_the_noise_floor_does_not_depend_on_chance(datasets):
    """Of a chaotic model the floor of 5 s ahead went up and down by a fifth with the seed."""
    from hydro.core.evaluation.regimes import Pieces
    from hydro.core.evaluation.replay_error import replay
    from hydro.core.prediction.candidate import candidate
    from hydro.io import table
    from hydro.io import vehicle as files

    vehicle = files.read(datasets / "stonefish" / "vehicle.toml")[0]
    record = recording(vehicle, table.read(datasets / "stonefish" / "replay90.parquet").frame)
    motion, pieces = Motion.of(record), Pieces.of(record)
    floors = []
    for seed in range(6):
        velocity, _ = replay(candidate(vehicle), record, motion, pieces, 5.0, seed)
        floors.append(np.sqrt(velocity.noise.sum(axis=0) / velocity.rows.sum()))
    spread = np.std(floors, axis=0, ddof=1) / np.mean(floors, axis=0)
    assert np.median(spread) < 0.1
    assert spread.max() < 0.2


def test_a_comparison_says_what_was_recorded():
    raw = flown(600)
    noisy = raw.with_columns(u=pl.col("u") + pl.Series(np.random.default_rng(0).normal(0.0, 0.05, 600)))
    rows = compare(heavier(1.0), noisy).filter(level="recording")
    (session,) = rows.filter(by="session").select("place", "rows", "rmse").rows()
    assert session == ("a", 600, pytest.approx(DT))
    noise = dict(rows.filter(by="all").select("axis", "rmse").iter_rows())
    assert noise["u"] == pytest.approx(0.05, rel=0.15)
    assert list(noise) == [*POSE, *VELOCITY]
