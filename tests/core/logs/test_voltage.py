"""The supply voltage of a log: where it is found, its unit, and how it is held on the rows."""

from __future__ import annotations

import logs
import msgspec
import numpy as np
import pytest

from hydro.core.errors import DataError
from hydro.core.guessing.aliases import guess
from hydro.core.logs.conventions import SessionLog
from hydro.core.logs.importing import raw_table
from hydro.core.logs.logmap import (
    Column,
    Valid,
    Voltage,
)
from hydro.io import logmap, mapdraft

NAMES, PLAIN = logs.NAMES, logs.PLAIN


def session(volts: np.ndarray) -> SessionLog:
    t = np.arange(500) / 50.0
    columns = dict(zip(NAMES, logs.motion(t).T, strict=True)) | {"cmd_1": np.sign(np.sin(t)), "bat": volts}
    return SessionLog("dive", t, columns)


def imported(volts: np.ndarray, **said: object) -> list[float | None]:
    meaning = msgspec.structs.replace(PLAIN, voltage=Voltage(**({"column": "bat"} | said)))
    return raw_table([session(volts)], meaning).frame["voltage"].to_list()


def rare(*values: float) -> np.ndarray:
    """A reading every 100 rows, from row 50 on."""
    column = np.full(500, np.nan)
    column[50::100] = values
    return column


def test_a_reading_is_held_to_the_next_and_null_before_the_first() -> None:
    found = imported(rare(16.0, 15.5, 15.0, 14.5, 14.0))
    assert found[:50] == [None] * 50
    assert found[50:150] == [16.0] * 100
    assert found[450:] == [14.0] * 50


def test_units_scales_and_what_does_not_count() -> None:
    millivolts = rare(16000.0, 65535.0, 15000.0, 14500.0, 14000.0)
    found = imported(millivolts, unit="mV", valid=Valid(differs=65535.0))
    assert found[60] == found[160] == pytest.approx(16.0)
    assert imported(rare(4.0, 4.0, 3.9, 3.9, 3.9), column=Column("bat", scale=4.0))[60] == pytest.approx(16.0)


@pytest.mark.parametrize(
    ("volts", "unit", "words"),
    [
        (rare(16000.0, 16000.0, 15000.0, 15000.0, 15000.0), "V", "set it to 'mV'"),
        (rare(16.0, 16.0, 15.0, 15.0, 15.0), "mV", "set it to 'V'"),
        (np.full(500, np.nan), "V", r"no number in any row; .+ leave \[voltage\] out"),
    ],
)
def test_a_wrong_unit_or_an_empty_column_is_told(volts: np.ndarray, unit: str, words: str) -> None:
    with pytest.raises(DataError, match=words):
        imported(volts, unit=unit)


@pytest.mark.parametrize(
    ("name", "block"),
    [
        ("/mavros/battery.voltage", {"column": "/mavros/battery.voltage"}),
        ("/auv/battery_state.voltage", None),
        ("battery_voltage_mV", {"column": "battery_voltage_mV", "unit": "mV"}),
        ("vbat", {"column": "vbat"}),
        ("/battery.cell_voltage[0]", None),
        ("thruster_voltage", None),
    ],
)
def test_the_battery_is_guessed_by_its_name(name: str, block: dict[str, object] | None) -> None:
    assert guess(["t", name]).get("voltage") == block


@pytest.mark.parametrize(
    ("names", "block"),
    [
        (["ATT.Roll", "ATT.Pitch", "ATT.Yaw", "RCOU.C1", "BAT[0].Volt"], {"column": "BAT[0].Volt"}),
        (
            [
                *(f"ATTITUDE.{angle}" for angle in ("roll", "pitch", "yaw")),
                *("SERVO_OUTPUT_RAW.servo1_raw", "SYS_STATUS.voltage_battery", "BATTERY_STATUS.voltages[0]"),
            ],
            {"column": "SYS_STATUS.voltage_battery", "unit": "mV", "valid": {"not": 65535.0}},
        ),
    ],
)
def test_the_autopilots_have_theirs(names: list[str], block: dict[str, object]) -> None:
    assert guess(names)["voltage"] == block
    draft = mapdraft.draft(guess(names), names, "log")
    assert "[voltage]" in draft
    assert msgspec.convert(block, Voltage) == Voltage(**_read(block))


def _read(block: dict[str, object]) -> dict[str, object]:
    return {k: Valid(differs=65535.0) if k == "valid" else v for k, v in block.items()}


def test_the_table_of_the_map_is_checked() -> None:
    text = '[position]\ndepth = "z"\n[commands]\ncolumns = ["c"]\n[voltage]\n'
    assert logmap.parse(text + 'column = "bat"\nunit = "mV"\n').voltage == Voltage(column="bat", unit="mV")
    with pytest.raises(DataError, match=r"voltage\.unit"):
        logmap.parse(text + 'column = "bat"\nunit = "kV"\n')
    with pytest.raises(DataError, match=r"voltage\.valid"):
        logmap.parse(text + 'column = "bat"\nvalid = {}\n')
