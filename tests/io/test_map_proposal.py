"""The map that a log suggests: names first, then what the motion contradicts, never what a person said."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from logs import motion
from scipy.spatial.transform import Rotation

from hydro.core.errors import DataError
from hydro.io import logmap
from hydro.io.files import bundled
from hydro.io.log import opened
from hydro.io.map_proposal import Proposal, proposed

EXAMPLE = bundled("logs") / "example.csv"


def proposal(path: Path, **given: str) -> Proposal:
    with ExitStack() as stack:
        return proposed([stack.enter_context(opened(path))], given)


def test_the_motion_corrects_the_names() -> None:
    found = proposal(EXAMPLE)
    assert found.blocks["velocity"]["frame"] == "FLU"
    assert found.notes == ("velocity looks FLU, not FRD: corrected",)
    right = logmap.read(bundled("logs") / "map.toml")
    read = logmap.from_guess(found.blocks, found.columns)
    assert (read.velocity, read.attitude, read.rates) == (right.velocity, right.attitude, right.rates)


def test_what_a_person_says_stays() -> None:
    found = proposal(EXAMPLE, velocity="dvl_{x,y,z} FRD", rates="none")
    assert found.blocks["velocity"]["frame"] == "FRD"
    assert "rates" not in found.blocks
    with pytest.raises(DataError, match="no column is called dvl_q"):
        proposal(EXAMPLE, velocity="dvl_x dvl_y dvl_q")


def test_a_late_sensor_gets_its_lag(tmp_path: Path) -> None:
    """A motion in closed form whose velocities are stamped 0.2 s late."""
    t = np.arange(0.0, 60.0, 0.05)
    now, before = motion(t), motion(t - 0.2)
    names = ("x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r")
    values = np.column_stack([now[:, :6], before[:, 6:9], now[:, 9:]])
    values += np.random.default_rng(1).normal(0.0, 1e-3, values.shape)
    frame = pl.DataFrame({"t": t, **dict(zip(names, values.T, strict=True)), "cmd_1": np.sin(t)})
    frame.write_csv(tmp_path / "late.csv")
    found = proposal(tmp_path / "late.csv")
    assert found.blocks["velocity"]["lag"] == pytest.approx(0.2, abs=0.02)
    assert [note for note in found.notes if note.startswith("velocity: stamps are 0.2")]
    assert "lag" not in found.blocks["position"]


def test_a_guess_with_holes_is_no_reason_to_fail(tmp_path: Path) -> None:
    pl.DataFrame({"time": [0.0, 1.0], "foo": [1.0, 2.0]}).write_csv(tmp_path / "log.csv")
    found = proposal(tmp_path / "log.csv")
    assert set(found.blocks) == {"time"}
    found = proposal(tmp_path / "log.csv", commands="foo", position="depth=foo")
    assert found.blocks["commands"] == {"columns": ["foo"]}


@pytest.mark.parametrize("filled", [True, False])
def test_samples_that_the_log_calls_invalid_do_not_count(filled: bool, tmp_path: Path) -> None:
    """A column that nobody fills in says nothing."""
    frame = pl.read_csv(EXAMPLE)
    lost = pl.int_range(pl.len()) % 40 < 8
    frame = frame.with_columns(dvl_valid=(pl.lit(filled) & ~lost).cast(pl.Int8))
    frame.with_columns(
        pl.when(lost & pl.col(name).is_not_null()).then(0.0).otherwise(pl.col(name)).alias(name)
        for name in ("dvl_x", "dvl_y", "dvl_z")
    ).write_csv(tmp_path / "log.csv")
    found = proposal(tmp_path / "log.csv")
    assert found.blocks["velocity"].get("valid") == ("dvl_valid" if filled else None)
    assert any("dvl_valid = 0 are excluded" in note for note in found.notes) == filled
    assert "valid" not in found.blocks["position"]


def test_commands_stamped_on_receipt_get_their_lag() -> None:
    """MAVROS stamps the outputs of this dive on receipt, on average 16 ms after they act."""
    found = proposal(bundled("dive") / "dive.bag")
    assert found.blocks["commands"]["lag"] == pytest.approx(0.016, abs=0.0005)
    assert [note for note in found.notes if note.startswith("commands: stamps are 0.016 s late")]


def test_the_faster_of_two_sources_that_agree_is_used() -> None:
    """The dive has its attitude ten times a second in the pose, and fifty times in the message of the IMU."""
    found = proposal(bundled("dive") / "dive.bag")
    assert found.blocks["attitude"]["quaternion"][0] == "/mavros/imu/data.orientation.x"
    assert found.blocks["position"]["columns"][0] == "/mavros/local_position/pose.pose.position.x"
    assert [note for note in found.notes if note.startswith("attitude: /mavros/imu/data")]


def test_a_faster_source_that_agrees_less_is_not_used(tmp_path: Path) -> None:
    """An attitude ten times a second, and another fifty times with an error of 3 degrees."""
    t = np.arange(0.0, 40.0, 0.02)
    values = motion(t)
    rng = np.random.default_rng(2)
    values[:, 9:] += rng.normal(0.0, 2e-3, (len(t), 3))
    noisy = values[:, 3:6] + rng.normal(0.0, 0.05, (len(t), 3))
    pose = Rotation.from_euler("ZYX", values[:, [5, 4, 3]]).as_quat()
    pose[np.arange(len(t)) % 5 > 0] = np.nan
    place = np.where(np.isnan(pose[:, :1]), np.nan, values[:, :3])
    imu = Rotation.from_euler("ZYX", noisy[:, ::-1]).as_quat()
    columns = {"time": t}
    for stem, parts, source in (
        ("/mavros/local_position/pose.pose.position", "xyz", place),
        ("/mavros/local_position/pose.pose.orientation", "xyzw", pose),
        ("/mavros/imu/data.orientation", "xyzw", imu),
        ("/mavros/imu/data.angular_velocity", "xyz", values[:, 9:]),
    ):
        columns |= {f"{stem}.{part}": column for part, column in zip(parts, source.T, strict=True)}
    columns |= {f"/mavros/rc/out.channels[{k}]": np.round(1500.0 + 300.0 * np.sin(t + k)) for k in range(8)}
    pl.DataFrame(columns).fill_nan(None).write_csv(tmp_path / "log.csv")
    found = proposal(tmp_path / "log.csv")
    assert found.blocks["attitude"]["quaternion"][0] == "/mavros/local_position/pose.pose.orientation.x"
