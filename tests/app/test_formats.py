from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hydro.app import opening
from hydro.app.live import Live
from hydro.app.opening import Craft
from hydro.app.panel_load import is_map, is_vehicle
from hydro.core.errors import DataError

LOGS = {
    "dive/ros2.db3": "mavros",
    "dive/ros2.mcap": "mavros",
    "dive/cut.tlog": "telemetry",
    "dive/cut.npz": "arrays",
    "dive/cut.mat": "arrays",
}


def quiet(words: str, share: float) -> None:
    """Ignore progress."""


@pytest.fixture(scope="module")
def heavy(datasets: Path) -> Craft:
    return Craft.read(datasets / "vehicles" / "bluerov2_heavy.toml")


LONG = {"dive/dive.bag": "mavros", "dive/dive.bin": "dataflash"}
"""Logs of two minutes, which take 3 s of processor time each."""


@pytest.mark.parametrize("log", [*LOGS, *(pytest.param(one, marks=pytest.mark.slow) for one in LONG)])
def test_each_bundled_format_opens_with_its_map(log: str, datasets: Path, heavy: Craft) -> None:
    pytest.importorskip("rosbags")
    path, map_ = str(datasets / log), str(datasets / "dive" / f"{(LOGS | LONG)[log]}.toml")
    assert not opening.is_table([path])
    opened = opening.open_recording([path], map_, heavy, quiet)
    assert any("rows at" in line for line in opened.lines)
    assert 0.0 < Live(opened).errors(heavy.vehicle, 1.0).all < 1.0


def test_a_raw_table_opens_alone(folder: Path, datasets: Path) -> None:
    raw, log = str(folder / "short.parquet"), str(datasets / "logs" / "example.csv")
    assert opening.is_table([raw])
    assert not opening.is_table([log, log])
    with pytest.raises(DataError, match=r"short\.parquet: a raw table opens alone"):
        opening.is_table([log, raw])


def test_sensors_without_columns_are_named_while_columns_are_unused() -> None:
    blocks: dict[str, dict[str, Any]] = {
        "time": {"column": "t"},
        "attitude": {"columns": ["roll", "pitch", {"column": "yaw"}]},
    }
    used = ("t", "roll", "pitch", "yaw")
    found = opening.Proposed((*used, "a", "b", "c"), blocks, {}, (), ())
    assert opening.unrecognised(found) == ["position", "velocity", "rates"]
    assert opening.unrecognised(opening.Proposed((*used, "a", "b"), blocks, {}, (), ())) == []


def test_implausible_rates_name_the_line_of_the_map(
    heavy: Craft, datasets: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*given: object, **options: object) -> None:
        raise DataError("raw: r [rad/s] must be at least -50: 3 of 9 rows are not")

    monkeypatch.setattr("hydro.io.recordings.imported", refuse)
    log = str(datasets / "logs" / "example.csv")
    with pytest.raises(DataError, match="are not: check the unit of rates in the map"):
        opening.open_recording([log], "map.toml", heavy, quiet)


def test_a_map_is_proposed_edited_and_written(datasets: Path, tmp_path: Path) -> None:
    log = [str(datasets / "logs" / "example.csv")]
    found = opening.propose_map(log, {}, None, quiet)
    assert found.missing == ()
    assert "unit" in opening.settings("velocity", found.blocks["velocity"])
    bare = opening.edited(found, "attitude", "roll_deg pitch_deg yaw_deg")
    assert opening.correct_map(log, found, bare, quiet).blocks["attitude"]["unit"] == "deg"
    stated = opening.edited(found, "attitude", "roll_deg pitch_deg yaw_deg rad")
    assert opening.correct_map(log, found, stated, quiet).blocks["attitude"]["unit"] == "rad"
    without = opening.edited(found, "rates", "none")
    changed = opening.correct_map(log, found, without, quiet)
    assert changed.lines["rates"] == "none"
    written = opening.write_map(changed, log, tmp_path / "map.toml")
    assert is_map(written)
    assert not is_vehicle(written)
    vehicle = Craft.read(datasets / "logs" / "rov.toml")
    opened = opening.open_recording(log, written, vehicle, quiet)
    assert opened.source.frame["p"].null_count() == opened.source.frame.height
    with pytest.raises(DataError, match="commands"):
        opening.write_map(
            opening.correct_map(log, found, opening.edited(found, "commands", "none"), quiet),
            log,
            tmp_path / "x",
        )
