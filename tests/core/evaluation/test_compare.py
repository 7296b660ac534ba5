"""Comparisons held to what was planted: noise alone, a weak thruster, drag, a current; and to plain numpy."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest
import synthetic
from hypothesis import given
from hypothesis import strategies as st

import hydro
from hydro.core.columns import POSE, VELOCITY
from hydro.core.errors import DataError
from hydro.core.evaluation import failure_regimes
from hydro.core.evaluation.compare import compare
from hydro.core.evaluation.regimes import Family, Pieces, conditions, families, phrase
from hydro.core.evaluation.replay_error import BEYOND, replay
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.prediction.candidate import candidate
from hydro.core.recording.arrays import recording
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.io import schema
from hydro.io import vehicle as files

DAMPING = (
    {"name": "linear_damping", "diagonal": synthetic.LINEAR.tolist()},
    {"name": "quadratic_damping", "diagonal": synthetic.QUADRATIC.tolist()},
)


def damped(*effects):
    known = synthetic.vehicle()
    return msgspec.structs.replace(known, effect=(*known.effect, *DAMPING, *effects))


def moved(vehicle, *, rows=3000, sessions=3, noise="ordinary") -> pl.DataFrame:
    """Sessions with a different slow sine on each thruster, measured with noise."""
    parts = []
    for session in range(sessions):
        rng, t = np.random.default_rng(session), np.arange(rows) * 0.02
        columns = {"session": [f"s{session}"] * rows, "t": t}
        for i in range(len(vehicle.thruster)):
            columns[f"cmd_{i + 1}"] = 0.6 * np.sin(2 * np.pi * rng.uniform(0.05, 0.3) * t + rng.uniform(0, 6))
        parts.append(simulate(vehicle, pl.DataFrame(columns)))
    frame = pl.concat(parts)
    motion = frame.select(*POSE, *VELOCITY).to_numpy()
    logged = disturb(motion, PROFILES[noise], np.random.default_rng(7))
    return frame.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))


@pytest.fixture(scope="module")
def true_model() -> pl.DataFrame:
    return compare(damped(), moved(damped()))


def planted(*effects) -> pl.DataFrame:
    """What the vehicle without some effects makes of a recording with them."""
    return compare(damped(), moved(damped(*effects)))


def whole(table: pl.DataFrame, level: str, horizon: float | None = None) -> dict[str, dict]:
    chosen = table.filter(pl.col("horizon").eq_missing(horizon), level=level, by="all")
    return {row["axis"]: row for row in chosen.iter_rows(named=True)}


# A model that is true.


def test_of_a_true_model_only_noise_is_left(true_model):
    for level, horizon in (("force", None), ("replay", 1.0), ("replay", 5.0), ("replay", 20.0)):
        for axis, row in whole(true_model, level, horizon).items():
            loose = 1.35 if axis in POSE[3:] else 1.15  # attitude is smoothed better than it has to be
            assert row["low"] / loose < row["noise_floor"] < row["high"] * loose, (horizon, axis)
            assert row["low"] <= row["rmse"] <= row["high"]
    force, near = whole(true_model, "force"), whole(true_model, "replay", 1.0)
    for row in (force["Z"], near["u"], near["r"], near["x"]):
        assert row["rmse"] == pytest.approx(row["noise_floor"], rel=0.06)


def test_a_true_model_fails_nowhere(true_model):
    assert true_model["rank"].is_null().all()
    assert whole(true_model, "force")["all"]["share"] == 0.0


def test_the_noise_floor_grows_with_the_noise():
    floors = [
        whole(compare(damped(), moved(damped(), sessions=1, noise=noise)), "force")["all"]["noise_floor"]
        for noise in ("none", "ordinary", "dvl")
    ]
    assert floors[0] < floors[1] < floors[2]


# What is planted is found where it lives.


def test_a_weak_thruster_is_found_on_its_axes_while_it_works():
    table = planted({"name": "thruster_gain", "g": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.4, 0.0]})
    ranked = table.filter(pl.col("rank").is_not_null())
    assert set(ranked["axis"]) <= {"Z", "K", "M"}, "thruster 7 is vertical, off both axes"
    single = table.filter(level="force", axis="Z", by="thruster T7")
    by_place = dict(single.select("place", "rmse").iter_rows())
    assert by_place["with T7 above +50 %"] > 3.0 * by_place["with T7 off"]
    other = table.filter(level="force", axis="Z", by="thruster T1")["rmse"]
    assert other.max() < 1.6 * other.min()


def test_the_force_of_a_weak_thruster_is_the_force_that_is_missing():
    gain = -0.4
    raw = moved(damped({"name": "thruster_gain", "g": [0.0] * 6 + [gain, 0.0]}), noise="none")
    row = whole(compare(damped(), raw), "force")["Z"]
    # The synthetic thrust is linear in the command behind a first-order lag; so by hand, in small steps.
    thrust = []
    for (_,), session in raw.group_by("session", maintain_order=True):
        state = 0.0
        for command in session["cmd_7"]:
            thrust.append(synthetic.MAX_THRUST * state)
            state += (1.0 - np.exp(-0.02 / synthetic.LAG)) * (command - state)
    assert row["rmse"] == pytest.approx(abs(gain) * np.sqrt(np.mean(np.square(thrust))), rel=0.02)


def test_missing_sway_drag_is_found_at_speed_and_sideways():
    table = planted({"name": "quadratic_damping", "diagonal": [0.0, 400.0, 0.0, 0.0, 0.0, 0.0]})
    ranked = table.filter(pl.col("rank").is_not_null()).sort("rank")
    assert set(ranked["axis"]) == {"Y"}
    assert any(word in ranked["place"][0] for word in ("sideways", "right", "left", "side", "above"))
    assert ranked["share"].sum() > 0.9
    drift = dict(table.filter(level="force", axis="Y", by="drift").select("place", "rmse").iter_rows())
    along = max(drift["while moving ahead"], drift["while moving astern"])
    assert min(drift["while moving right"], drift["while moving left"]) > 2.0 * along


def test_a_current_is_found_in_the_position_and_by_heading():
    table = planted({"name": "ocean_current", "v_N": 0.3, "v_E": 0.0, "v_D": 0.0})
    drift = whole(table, "replay", 20.0)
    assert drift["x"]["rmse"] > 10.0 * drift["x"]["noise_floor"]
    assert drift["x"]["rmse"] > 2.0 * drift["z"]["rmse"]
    for axis, along in (("X", "north or south"), ("Y", "east or west")):
        # Water that flows north pushes along the hull where that points north or south, else sideways.
        heading = table.filter(level="force", axis=axis, by="heading").sort("rmse")["place"]
        assert heading[-1].removeprefix("while heading ") in along, axis


# Against an independent computation.


def test_squares_of_a_whole_run_are_those_of_simulate():
    """One prediction from the first row of each session, beside `simulation.simulate` and numpy."""
    raw = moved(damped({"name": "net_buoyancy", "dB": 12.0}), rows=1000, sessions=2, noise="none")
    expected = simulate(damped(), raw).select(VELOCITY).to_numpy() - raw.select(VELOCITY).to_numpy()
    rows = whole(compare(damped(), raw), "replay", None)
    rmse = np.sqrt(np.mean(expected**2, axis=0))
    found = [rows[axis]["rmse"] for axis in VELOCITY]
    np.testing.assert_allclose(found, rmse, rtol=0.02, atol=2e-4)


def test_bands_of_frequency_are_parts_of_one_force():
    table = planted({"name": "net_buoyancy", "dB": 12.0})
    bands = dict(table.filter(by="frequency", axis="Z").select("place", "rmse").iter_rows())
    squares = np.square([rmse for words, rmse in bands.items() if "faster" not in words])
    assert squares.sum() == pytest.approx(whole(table, "force")["Z"]["rmse"] ** 2, rel=1e-6)
    forces = whole(table, "force")
    lost = np.sqrt(sum(forces[axis]["rmse"] ** 2 - forces[axis]["noise_floor"] ** 2 for axis in "XYZ"))
    assert lost == pytest.approx(12.0, rel=0.05), "the buoyancy itself, whatever the attitude"


# Shares, order, and pieces.


def test_shares_are_parts_of_one_whole():
    table = planted({"name": "net_buoyancy", "dB": 12.0}, {"name": "payload", "w": 10.0, "x": 0.2})
    for (by, level, horizon), part in table.filter(
        pl.col("axis") != "all", pl.col("axis") != "pose"
    ).group_by("by", "level", "horizon"):
        velocity = part.filter(~pl.col("axis").is_in(POSE))
        assert velocity["share"].sum() <= 1.0 + 1e-9, (by, level, horizon)
        assert velocity["share"].min() >= 0.0
    assert table["share"].max() <= 1.0


def test_a_comparison_keeps_its_schema(true_model):
    rules = schema.load("comparison")
    assert rules.check(rules.conform(true_model), "x").equals(true_model)


def test_a_session_is_one_block_of_a_whole_run(true_model):
    assert whole(true_model, "replay", None)["u"]["low"] is not None
    alone = compare(damped(), moved(damped(), rows=1000, sessions=1))
    assert whole(alone, "replay", None)["u"]["low"] is None
    assert whole(alone, "replay", 1.0)["u"]["low"] is not None


def test_the_order_of_sessions_changes_no_error():
    truth, rows = damped({"name": "net_buoyancy", "dB": 12.0}), 1500
    raw = moved(truth, rows=rows)
    other = pl.concat([raw[2 * rows :], raw[:rows], raw[rows : 2 * rows]])
    key = ["level", "horizon", "axis", "by", "place"]
    first = compare(damped(), raw).filter(pl.col("by") != "place").select(*key, "rows", "rmse").sort(key)
    second = compare(damped(), other).filter(pl.col("by") != "place").select(*key, "rows", "rmse").sort(key)
    assert first.drop("rmse").equals(second.drop("rmse"))
    np.testing.assert_allclose(first["rmse"], second["rmse"], rtol=1e-6)


def test_angles_may_jump_by_a_turn():
    raw = moved(damped(), sessions=1, rows=1500)
    turned = raw.with_columns(psi=pl.col("psi") + 2.0 * np.pi)
    first, second = (compare(damped(), frame)["rmse"] for frame in (raw, turned))
    np.testing.assert_allclose(first, second, rtol=1e-6, atol=1e-9)


def test_against_an_earlier_comparison():
    truth = damped({"name": "net_buoyancy", "dB": 20.0})
    raw = moved(truth)
    before = compare(damped(), raw)
    after = compare(truth, raw, against=before)
    heave = whole(after, "force")["Z"]
    assert heave["before"] == pytest.approx(whole(before, "force")["Z"]["rmse"])
    assert heave["rmse"] < 0.7 * heave["before"]
    ranked = before.filter(
        pl.col("rank").is_not_null(),
        ~pl.col("place").is_in([failure_regimes.ELSEWHERE, failure_regimes.THROUGHOUT]),
    )
    again = after.filter(by="place").select("axis", "place", "before")
    assert set(ranked.select("axis", "place").rows()) <= set(again.select("axis", "place").rows())
    assert again["before"].null_count() == 0
    rules = schema.load("comparison")
    assert rules.check(rules.conform(after), "x").equals(after)


# Places and words.


@given(
    shape=st.tuples(st.integers(60, 200), st.integers(1, 3)),
    seed=st.integers(0, 2**32 - 1),
)
def test_places_hold_one_piece_and_axis_once(shape, seed):
    count, axes = shape
    rng = np.random.default_rng(seed)
    groups = [
        Family(f"kind {i}", tuple(f"c{i}{k}" for k in range(3)), rng.integers(-1, 3, count)) for i in range(4)
    ]
    error = rng.exponential(size=(count, axes)) ** 3 * (1.0 + 5.0 * (groups[0].code == 1)[:, None])
    error /= error.sum()
    listed = failure_regimes.rank(error, np.full(count, 10.0), np.arange(count) // 5, groups)
    for axis in range(axes):
        held = [place for place in listed if place.axis == axis]
        assert sum(place.share for place in held) <= error[:, axis].sum() + 1e-9
    assert len({(place.axis, place.words) for place in listed}) == len(listed)
    for place in listed:
        if place.words not in (failure_regimes.ELSEWHERE, failure_regimes.THROUGHOUT):
            assert (failure_regimes.find({place.words}, groups)[place.words] == place.met).all()


def test_a_planted_place_is_ranked_first():
    rng, count = np.random.default_rng(0), 1500
    turn = Family("turn", ("turning left", "going straight", "turning right"), rng.integers(0, 3, count))
    speed = Family("speed", ("below 0.8 m/s", "above 0.8 m/s"), rng.integers(0, 2, count), doing=False)
    other = Family("heading", ("heading north", "heading south"), rng.integers(0, 2, count))
    error = np.full((count, 2), 1.0)
    error[(turn.code == 2) & (speed.code == 1), 1] = 40.0
    listed = failure_regimes.rank(
        error / error.sum(), np.full(count, 10.0), np.arange(count) // 50, [other, speed, turn]
    )
    assert (listed[0].axis, listed[0].words) == (1, "while turning right above 0.8 m/s")
    assert listed[0].share == pytest.approx(error[error == 40.0].sum() / error.sum())
    assert [place.words for place in listed[1:]] == ["in all motion", "in all other motion"]


@pytest.mark.parametrize(("seconds", "told"), [(2.0, False), (5.0, True)])
def test_a_place_of_hardly_any_time_is_not_told_of(seconds, told):
    """However much of the error it holds, where it lasts less than a hundredth of the time."""
    count = 2000  # pieces of 0.2 s
    met = np.zeros(count, int)
    met[:: round(count / (seconds / 0.2))] = 1
    turn = Family("turn", ("going straight", "turning"), met)
    error = np.where(met == 1, 2000.0, 1.0)[:, None]
    listed = failure_regimes.rank(error / error.sum(), np.full(count, 10.0), np.arange(count) // 200, [turn])
    assert ("while turning" in {place.words for place in listed}) is told


def test_words_in_the_order_of_speech():
    assert phrase([("above 0.8 m/s", False), ("turning right", True)]) == "while turning right above 0.8 m/s"
    assert phrase([("climbing", True), ("braking", True)]) == "while climbing and braking"
    assert phrase([("below 1 m/s", False), ("with T3 off", False)]) == "below 1 m/s and with T3 off"


def test_conditions_are_what_the_vehicle_does():
    """A straight run north at 1 m/s, then a right turn while diving."""
    vehicle, rows = damped(), 2000
    still = {name: np.zeros(rows) for name in (*POSE, *VELOCITY)}
    still |= {f"cmd_{i + 1}": np.zeros(rows) for i in range(8)}
    turning = np.arange(rows) >= 1000
    still["u"] = np.full(rows, 1.0)
    still["r"], still["w"] = 0.3 * turning, 0.4 * turning
    still["psi"] = np.cumsum(still["r"]) * 0.02
    raw = pl.DataFrame({"session": ["a"] * rows, "t": np.arange(rows) * 0.02, **still})
    record = recording(vehicle, raw)
    pieces = Pieces.of(record)
    eta, nu = record.eta, record.nu
    found = families(record, vehicle, pieces, eta, nu, np.zeros((rows, 6)), ["a"])
    met = {condition.words: condition.met for condition in conditions(found)}
    late = turning[pieces.starts]
    assert (met["turning right"] == late).all()
    assert (met["going straight"] == ~late).all()
    assert (met["diving"] == late).all()
    assert met["heading north"][~late].all()
    assert "coasting" not in met, "a family with one condition tells nothing apart"
    assert not any("session" in words for words in met)


def test_pieces_neither_cross_gaps_nor_lose_rows():
    raw = moved(damped(), rows=333, sessions=2)
    gap = raw.with_columns(t=pl.col("t") + pl.when(pl.int_range(pl.len()) >= 100).then(5.0).otherwise(0.0))
    record = recording(damped(), gap)
    pieces = Pieces.of(record)
    assert pieces.total(np.ones(record.rows)).sum() == record.rows
    assert set(record.segments[:, 0]) <= set(pieces.starts)
    assert (np.diff(pieces.block) >= 0).all()


# What cannot be compared.


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda raw: raw.drop("cmd_8"), "7 command columns"),
        (lambda raw: raw.drop("w"), "no column w"),
        (lambda raw: raw.with_columns(u=float("nan")), "u is not finite in row 0"),
        (lambda raw: raw.reverse(), "must rise"),
        (lambda raw: raw[:3], "record longer"),
        (lambda raw: raw[:0], "no rows"),
    ],
)
def test_recordings_that_cannot_be_compared(change, message):
    with pytest.raises(DataError, match=message) as caught:
        compare(damped(), change(moved(damped(), rows=200, sessions=1)))
    assert "\n" not in str(caught.value)


def test_an_earlier_comparison_that_is_none():
    with pytest.raises(DataError, match="no column level"):
        compare(damped(), moved(damped(), rows=200, sessions=1), against=pl.DataFrame({"x": [1.0]}))


def test_a_short_recording_has_no_long_horizons():
    table = compare(damped(), moved(damped(), rows=300, sessions=2))
    assert set(table.filter(level="replay")["horizon"]) == {1.0, 5.0, None}


def test_a_motion_without_bounds_counts_at_its_bound():
    wild = damped({"name": "linear_damping", "diagonal": [-9e3] * 6})
    raw = moved(damped(), rows=300, sessions=1)
    record = recording(damped(), raw)
    both = replay(candidate(wild), record, Motion.of(record), Pieces.of(record), None, 0)
    assert both is not None
    for one in both:
        assert np.isfinite(one.squares).all()
        assert (np.sqrt(one.squares.sum(axis=0) / one.rows.sum()) <= BEYOND.max()).all()


@pytest.mark.parametrize("pitch", [0.2, 0.4])
def test_a_loop_through_the_vertical_has_no_error_of_the_files_own(datasets, pitch):
    """Roll and heading jump by half a turn there; smoothed as angles they would begin predictions askew."""
    known, _ = files.read(datasets / "logs" / "rov.toml")
    t, levels = np.arange(400) * 0.05, [0.0] * 4 + [pitch, pitch, -pitch, -pitch]
    commands = {f"cmd_{i + 1}": np.full(400, level) for i, level in enumerate(levels)}
    looped = simulate(known, pl.DataFrame({"session": ["a"] * 400, "t": t, **commands}))
    assert looped["q"].abs().max() > 1.0
    errors = hydro.compare(known, looped).filter(level="replay", by="all")
    assert errors.filter(pl.col("axis").is_in(["p", "r", "phi", "psi"]))["rmse"].max() < 1e-3
