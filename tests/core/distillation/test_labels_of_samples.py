"""Labels of recordings with nulls: what samples determine, how well, and what is said of the rest."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import polars as pl
import pytest
import synthetic

from hydro import cli
from hydro.core.columns import MOTION, POSE, VELOCITY, WRENCH
from hydro.core.distillation.features import table as features
from hydro.core.distillation.labels import acceleration_sd, labelled, labels, smoother_reach
from hydro.core.distillation.labels_of_samples import DEVIATIONS, Bounds, unlabelled
from hydro.core.distillation.split import split
from hydro.core.errors import DataError
from hydro.core.recording.kinematic_smoother import smooth
from hydro.io import schema, table

NOISE = np.repeat([0.02, 0.001, 0.01, 0.002], 3)
RES = [f"{name}_res" for name in WRENCH]
SPEEDS, ANGLES = ("u", "v", "w"), ("phi", "theta", "psi")


@pytest.fixture(scope="module")
def vehicle():
    return synthetic.vehicle()


@pytest.fixture(scope="module")
def flown() -> pl.DataFrame:
    """Twenty seconds with noise on every channel."""
    raw, rng = synthetic.recording(20.0), np.random.default_rng(0)
    motion = raw.select(MOTION).to_numpy() + rng.normal(size=(raw.height, 12)) * NOISE
    return raw.with_columns(pl.DataFrame(motion, schema=list(MOTION)))


def thinned(raw: pl.DataFrame, every: dict[str, int]) -> pl.DataFrame:
    """With samples of a column in one of so many rows; in none where that is 0."""
    row = pl.int_range(pl.len())
    return raw.with_columns(
        (pl.when(row % n == n // 2).then(name) if n else pl.lit(None, pl.Float64)).alias(name)
        for name, n in every.items()
    )


DVL = {**dict.fromkeys(SPEEDS, 10), "x": 0, "y": 0}


@pytest.fixture(scope="module")
def sparse(flown) -> pl.DataFrame:
    """Doppler velocity at 5 Hz, an attitude reference and a depth sensor; no position."""
    return thinned(flown, DVL)


@pytest.fixture(scope="module")
def made(vehicle, sparse) -> pl.DataFrame:
    return labels(vehicle, sparse)


def truth() -> np.ndarray:
    nu = synthetic.recording(20.0).select(VELOCITY).to_numpy()
    return np.array([synthetic.coriolis_and_damping(row) for row in nu])


def test_forces_lie_within_their_standard_deviations(made):
    """Against scipy: X ... N from velocity at 5 Hz, and no position."""
    assert unlabelled(made) == ""
    spread = made.select(f"{name}_sd" for name in RES).to_numpy()
    score = (made.select(RES).to_numpy() - truth()) / spread
    held = (np.abs(score)[5:-5] < 1.96).mean(axis=0)
    assert (held > 0.85).all()
    assert held.mean() > 0.9
    assert (np.sqrt((score[5:-5] ** 2).mean(axis=0)) < 1.5).all()


@pytest.mark.parametrize(
    ("causes", "more"), [(1, ""), (3, ""), (5, " and 2 more causes"), (9, " and 6 more causes")]
)
def test_three_causes_are_told_and_the_others_are_counted(causes, more):
    """Row k, k + 1 times, has one standard deviation beyond its bound, another in each."""
    rows = np.repeat(np.arange(causes), np.arange(causes) + 1)
    spread = 1e-3 + 1e3 * np.eye(len(DEVIATIONS))[rows]
    labels = pl.DataFrame(spread, schema=list(DEVIATIONS)).with_columns(pl.lit(None).alias(RES[0]))
    told = unlabelled(labels)
    assert told.endswith(f"({max(causes - 2, 1):,}){more}")
    assert told.count(" is not determined to ") == min(causes, 3)


def test_labels_with_nulls_are_near_those_without(vehicle, flown, made):
    whole = labels(vehicle, flown)
    for name in (*(f"{name}_s" for name in VELOCITY), *(f"{name}_dot" for name in VELOCITY)):
        off = (made[name] - whole[name]).to_numpy()[10:-10]
        complete = np.std(np.diff(whole[name].to_numpy(), 3)) / np.sqrt(20.0)  # its own noise
        bound = np.hypot(made[f"{name}_sd"].to_numpy()[10:-10], complete)
        assert (np.abs(off) < 3.0 * bound + 0.05 * whole[name].std()).mean() > 0.95, name


def test_a_null_in_one_row_changes_little(vehicle, flown):
    """Both smoothers on the same samples: velocities agree within the noise of the log."""
    almost = flown.with_columns(pl.when(pl.int_range(pl.len()) != 500).then("r").alias("r"))
    one, other = labels(vehicle, almost), labels(vehicle, flown)
    for name, sigma in zip(VELOCITY, NOISE[6:], strict=True):
        off = (one[f"{name}_s"] - other[f"{name}_s"]).to_numpy()[5:-5]
        assert np.sqrt(np.mean(off**2)) < sigma


@pytest.mark.parametrize(
    ("sensors", "words"),
    [
        ({"psi": 0}, "1,000 of 1,000 rows have no label: heading is not measured (1,000)"),
        ({"phi": 0, "theta": 0}, "roll and pitch is not measured (1,000)"),
        (dict.fromkeys(("x", "y", *SPEEDS), 0), "surge velocity is not determined to 0.05 m/s"),
    ],
)
def test_what_is_not_determined_has_no_label_and_is_named(vehicle, flown, sensors, words):
    found = labels(vehicle, thinned(flown, sensors))
    assert found["X_res"].null_count() == found.height
    assert words in unlabelled(found)
    with pytest.raises(DataError, match="no row has a label"):
        split(found)


def test_where_a_sensor_is_silent_for_long_there_is_no_label(vehicle, sparse):
    silent = pl.int_range(pl.len()).is_between(400, 700)
    found = labels(vehicle, sparse.with_columns(pl.when(~silent).then(name).alias(name) for name in SPEEDS))
    missing = np.flatnonzero(found["X_res"].is_null())
    assert 400 <= missing[0] < 450
    assert 650 < missing[-1] <= 700
    assert unlabelled(found).startswith(f"{len(missing):,} of 1,000 rows have no label: ")
    assert found["u_dot"].is_null().equals(found["X_res"].is_null())
    assert not found.select(DEVIATIONS).null_count().sum_horizontal().item()


def test_tighter_bounds_keep_fewer_rows(vehicle, sparse):
    counts = [
        labelled(labels(vehicle, sparse, limits=Bounds(velocity, 0.25))).height
        for velocity in (0.05, 0.008, 0.001)
    ]
    assert counts[0] > counts[1] > counts[2] == 0


def test_only_the_smoother_copes_with_nulls(vehicle, sparse):
    with pytest.raises(DataError, match=r"--acceleration rts.*--fill"):
        labels(vehicle, sparse, acceleration="kalman")
    with pytest.raises(DataError, match="six standard deviations"):
        labels(vehicle, sparse, noise=[0.01])
    odd = pl.when(pl.int_range(pl.len()) == 3).then(np.nan).otherwise("q").alias("q")
    with pytest.raises(DataError, match="q is not finite in row 3"):
        labels(vehicle, sparse.with_columns(odd))


def test_known_noise_is_used(vehicle, sparse):
    more, less = (labels(vehicle, sparse, noise=[s] * 3 + [0.002] * 3)["u_s_sd"].mean() for s in (0.05, 0.01))
    assert more > 1.5 * less


def test_forces_that_depend_on_the_place_need_the_place(vehicle, flown, sparse):
    tether = {
        "name": "tether",
        "k": 6.0,
        "slack": 0.5,
        "anchor": [2.0, 1.0, 0.0],
        "attachment": [0.5, 0.0, 0.1],
    }
    held = msgspec.structs.replace(vehicle, effect=(*vehicle.effect, tether))
    assert labelled(labels(held, sparse)).height == sparse.height
    found = labels(held, sparse, subtract="effects")
    assert labelled(found).height == 0
    assert "position to 0.1 m" in unlabelled(found)
    assert labelled(labels(held, thinned(flown, dict.fromkeys(SPEEDS, 10)), subtract="effects")).height > 900


def test_split_and_features_leave_out_rows_without_a_label(vehicle, sparse, made):
    some = made.with_columns(
        pl.when(pl.int_range(pl.len()) % 200 > 20).then(name).alias(name) for name in RES
    )
    parts, blocks = split(some, test=0.5, guard=5)
    every, all_blocks = split(made, test=0.5, guard=5)
    assert parts.equals(every.filter(pl.Series(np.arange(1000) % 200 > 20)))
    assert blocks.equals(all_blocks)
    assert features(some).height == parts.height
    assert table.make("split", parts, stage="split").frame.equals(parts)


def test_guards_are_as_wide_as_the_smoother_reaches(sparse):
    """Beyond the reach a sample's weight is below a thousandth of the greatest, a few times at most."""
    samples = sparse.select(MOTION).to_numpy()
    moved, at, bounds = samples.copy(), 505, np.array([[0, 1000]])
    moved[at, 6] += 0.01
    before, after = (
        smooth(each, bounds, 0.02, NOISE, density=np.tile([0.01, 5.0], (6, 1))) for each in (samples, moved)
    )
    spread = {
        f"{name}{end}_sd": before.motion_sd[:, i, k]
        for k, end in enumerate(("_s", "_dot"))
        for i, name in enumerate(VELOCITY)
    }
    rows = smoother_reach(
        sparse.with_columns(X_res=0.0, **{name: pl.Series(sd) for name, sd in spread.items()})
    )
    weight = np.abs(after.motion - before.motion)[:, 0]
    far = np.abs(np.arange(1000) - at) > rows
    assert 20 < rows < 200
    assert (weight[far].max(axis=0) < 3e-3 * weight.max(axis=0)).all()


def test_the_command_says_how_many_rows_have_no_label_and_why(tmp_path, capsys):
    """From a log with Doppler velocity and position at 5 Hz in rows of 20 Hz, through to features."""
    folder = Path(__file__).resolve().parents[3] / "datasets"
    raw, made, parts, inputs = (str(tmp_path / f"{name}.parquet") for name in ("raw", "labels", "split", "x"))
    vehicle = str(folder / "logs" / "rov.toml")
    log = [str(folder / "logs" / name) for name in ("example.csv", "map.toml")]
    assert cli.main(["import", log[0], "--map", log[1], "--vehicle", vehicle, "-o", raw]) == 0
    assert cli.main(["labels", raw, "--max-sd-acceleration", "0.04", "-o", made]) == 0
    told = capsys.readouterr().err
    found = table.read(Path(made))
    missing = found.frame["X_res"].null_count()
    assert 0 < missing < found.frame.height
    assert f"{missing} of 1,286 rows have no label: " in told
    assert "acceleration is not determined to 0.04 m/s^2 (" in told
    assert found.provenance.parameters["max_sd_acceleration"] == 0.04
    assert cli.main(["split", made, "--block", "400", "--test", "0.5", "-o", parts]) == 0
    assert cli.main(["features", made, "-o", inputs]) == 0
    assert f"{missing} of 1,286 rows have no label and are left out" in capsys.readouterr().err
    kept = found.frame.height - missing
    assert [table.read(Path(one)).frame.height for one in (parts, inputs)] == [kept, kept]
    assert cli.main(["check", raw, made, parts, inputs]) == 0


def test_the_tables_are_of_version_two_and_only_they(vehicle, flown, made):
    second = table.make("labels", made, stage="labels")
    assert second.provenance.schema == schema.load("labels", 2).digest
    first = table.make("labels", labels(vehicle, flown), stage="labels")
    assert first.provenance.schema == schema.load("labels").digest
    assert not set(DEVIATIONS) & set(first.frame.columns)
    assert list(second.frame.columns) == [*first.frame.columns, *DEVIATIONS]


def test_noise_of_accelerations_is_that_of_the_labels(made):
    expected = np.sqrt((made.select(f"{name}_dot_sd" for name in VELOCITY).to_numpy() ** 2).mean(axis=0))
    np.testing.assert_allclose(acceleration_sd(made), expected, rtol=1e-5)
    assert set(POSE) <= set(made.columns)
