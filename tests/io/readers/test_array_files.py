"""Arrays of several lengths in one file, as each sensor has its own rate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hydro
from hydro.core.errors import DataError
from hydro.io import log
from hydro.io.readers.arrays import _numeric_arrays
from hydro.io.readers.messages import DEEPEST

FAST, SLOW = np.arange(200) * 0.05, np.arange(41) * 0.25
MAP = """
[time]
column = "{time}"
[position]
depth = "depth.z"
[rates]
columns = ["gyro[0]", "gyro[1]", "gyro[2]"]
[commands]
columns = ["cmd[0]", "cmd[1]"]
"""


def arrays() -> dict[str, np.ndarray]:
    return {
        "t": FAST,
        "gyro": np.stack([np.sin(FAST), np.cos(FAST), 0.0 * FAST], axis=1),
        "cmd": np.full((200, 2), 0.5),
        "depth.time": SLOW,
        "depth.z": 1.0 + 0.1 * SLOW,
        "gains": np.arange(7.0),
    }


def saved(path: Path, **changes: np.ndarray) -> Path:
    np.savez(path, **{**arrays(), **changes})
    return path


@pytest.mark.parametrize("time", ["time", "t"])
def test_sensors_of_two_rates_make_one_recording(time, tmp_path):
    (tmp_path / "map.toml").write_text(MAP.format(time=time))
    frame, _ = hydro.import_log(saved(tmp_path / "log.npz"), tmp_path / "map.toml")
    there = frame.drop_nulls("z")
    np.testing.assert_allclose(there["z"], 1.0 + 0.1 * there["t"].to_numpy(), atol=1e-9)
    np.testing.assert_allclose(frame["p"], np.sin(frame["t"].to_numpy()), atol=1e-9)
    assert (frame["cmd_2"] == 0.5).all()


def test_what_has_no_times_is_left_out_with_a_note(tmp_path):
    found = log.read(saved(tmp_path / "log.npz"))
    assert "gains" not in found.table.columns
    assert found.notes[0].startswith("arrays of several lengths: those of each clock (t, depth.time)")
    assert found.notes[1] == "left out, because no times have their length: gains"


def test_clocks_without_a_common_time_are_refused(tmp_path):
    with pytest.raises(DataError, match=r"the clocks t .0 to 9.95. and depth.time .* no time in common"):
        log.read(saved(tmp_path / "log.npz", **{"depth.time": SLOW + 1e9}))


def test_an_array_of_another_length_without_times_is_still_refused(tmp_path):
    (tmp_path / "map.toml").write_text(MAP.format(time="t").replace("depth.z", "gains"))
    with pytest.raises(DataError, match="name arrays of one length in the map"):
        hydro.import_log(saved(tmp_path / "log.npz"), tmp_path / "map.toml")


def test_arrays_are_found_in_structs_as_deep_as_all_readers_go():
    array = np.arange(4.0)
    nested: dict[str, Any] = {"x": array}
    for _ in range(DEEPEST):
        nested = {"s": nested, "n": "text"}
    ((name, found),) = _numeric_arrays(nested, "", 0)
    assert (name, found.tolist()) == (".".join(["s"] * DEEPEST) + ".x", array.tolist())
    assert not [*_numeric_arrays({"s": nested}, "", 0)]
