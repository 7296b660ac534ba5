"""The bundled dive in every format: by its map, the motion that was simulated, on clocks that agree."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import dive_logs
import log_writers
import numpy as np
import polars as pl
import pytest
from dive import DVL_LATE, MIXED, NOISE, Dive, dive

import hydro
from hydro.io import log, logmap
from hydro.io.log_import import ImportReport

FOLDER = Path(__file__).resolve().parents[3] / "datasets" / "dive"
WORST = 5.5
"""Standard deviations that the worst of some thousand samples may be off."""
STEP = 0.02
"""What moving samples to their nearest rows along a line, and held commands, may add to a noise, relative."""


@dataclass(frozen=True)
class Kind:
    """How one of the files is read, and how long a unit of its fields is."""

    map: str
    angle: float = 0.0  # rad
    velocity: float = 0.0  # m/s
    depth: float = 0.0  # m
    velocity_noise: float = NOISE["velocity"]


KINDS = {
    "dive.bag": Kind("mavros"),
    "ros2.mcap": Kind("mavros"),
    "ros2.db3": Kind("mavros"),
    "dive.bin": Kind("dataflash", angle=np.radians(0.01)),
    "cut.tlog": Kind("telemetry", velocity=0.01, depth=0.001, velocity_noise=0.0),
    "blueos.mcap": Kind("blueos"),
    "cut.npz": Kind("arrays"),
    "cut.mat": Kind("arrays"),
}


@cache
def truth() -> Dive:
    return dive()


@cache
def imported(name: str) -> tuple[pl.DataFrame, ImportReport]:
    return hydro.import_log(FOLDER / name, FOLDER / f"{KINDS[name].map}.toml")


@pytest.mark.parametrize("name", KINDS)
def test_what_is_read_is_what_was_flown(name: str) -> None:
    kind = KINDS[name]
    frame, _ = imported(name)
    true = truth().truth
    t = true["t"].to_numpy()
    quantities = {
        "xy": (NOISE["position"], 0.0),
        "z": (NOISE["depth"], kind.depth),
        "angles": (NOISE["attitude"], kind.angle),
        "uvw": (kind.velocity_noise, kind.velocity),
        "pqr": (NOISE["rates"], 0.0),
    }
    columns = {"xy": "xy", "z": "z", "angles": ("phi", "theta", "psi"), "uvw": "uvw", "pqr": "pqr"}
    for quantity, (noise, unit) in quantities.items():
        for column in columns[quantity]:
            rows = frame.select("t", column).drop_nulls()
            assert rows.height >= 40
            angle = column in ("phi", "psi")
            known = np.unwrap(true[column].to_numpy()) if angle else true[column].to_numpy()
            error = rows[column].to_numpy() - np.interp(rows["t"].to_numpy(), t, known)
            error = np.angle(np.exp(1j * error)) if angle else error
            allowed = np.hypot(noise, unit / np.sqrt(12.0)) + STEP * (0.1 if quantity == "uvw" else noise)
            assert np.sqrt(np.mean(error**2)) < 1.15 * allowed, (column, noise)
            assert np.abs(error).max() < WORST * noise + unit + STEP * 0.5, column


@pytest.mark.parametrize("name", KINDS)
def test_commands_are_the_pulses_that_the_thrusters_had(name: str) -> None:
    frame, _ = imported(name)
    sent = truth().pulses
    rows = frame.select("t", "cmd_3")
    at = np.clip(np.searchsorted(sent.t, rows["t"].to_numpy(), "right") - 1, 0, None)
    apart = np.abs(rows["cmd_3"].to_numpy() - (sent.values[at, 2] - 1500.0) / 400.0)
    assert np.median(apart) < 0.02, "between two outputs a row has their mean"


@pytest.mark.parametrize("name", ["dive.bag", "dive.bin", "blueos.mcap", "ros2.mcap"])
def test_pings_without_bottom_are_left_out_and_repeats_counted_once(name: str) -> None:
    frame, report = imported(name)
    pings = truth().dvl
    last = frame["t"][-1] + DVL_LATE
    there = frame["u"].drop_nulls().len()
    assert there == pytest.approx(int(pings.valid[pings.t < last].sum()), abs=3)
    assert (frame.select("u", "v", "w").drop_nulls() == 0.0).sum().row(0) == (0, 0, 0)
    assert any("samples are not valid by the map and left out" in line for line in report.lines())
    repeats = any("only repeat the last one" in line for line in report.lines())
    assert repeats == (KINDS[name].map == "mavros")


@pytest.mark.parametrize("name", ["dive.bag", "dive.bin"])
def test_the_late_doppler_log_is_found_inside_its_interval(name: str) -> None:
    text = (FOLDER / f"{KINDS[name].map}.toml").read_text()
    assert f"lag = {DVL_LATE}\n" in text
    _, report = hydro.import_log(FOLDER / name, logmap.parse(text.replace(f"lag = {DVL_LATE}\n", "")))
    (late,) = [one for one in report.clocks.sensors if one.block == "velocity"]
    assert late.low < DVL_LATE < late.high
    assert late.high - late.low < 0.5 * late.step, "much less than the time between its pings"
    assert any("velocity is stamped" in line and "lag = 0.1" in line for line in report.lines())
    for one in imported(name)[1].clocks.sensors:
        assert abs(one.seconds) < max(0.75 * (one.high - one.low), 1e-3), "about the interval"


def test_the_silence_of_the_logger_is_a_gap() -> None:
    for name in ("dive.bag", "dive.bin"):
        (gap,) = imported(name)[1].imported.gaps
        assert gap.stop - gap.start == pytest.approx(3.6, abs=0.3)


@pytest.mark.parametrize("name", ["dive.bag", "dive.bin", "cut.tlog"])
def test_a_guess_reads_the_same_pose_and_commands(name: str) -> None:
    guessed, report = hydro.import_log(FOLDER / name)
    known, _ = imported(name)
    assert len(report.map.commands.columns) == 8
    for column in ("x", "psi", "cmd_8"):
        one, other = (frame.select("t", column).drop_nulls() for frame in (guessed, known))
        a, b = (np.interp(known["t"], each["t"], each[column]) for each in (one, other))
        assert np.median(np.abs(a - b)) < 0.03, column


def test_the_files_are_what_the_script_writes(tmp_path: Path) -> None:
    whole = truth()
    made = log_writers.dataflash(tmp_path / "dive.bin", dive_logs.autopilot(whole), dive_logs.DATAFLASH)
    outputs = [f"RCOU.C{i + 1}" for i in range(8)]
    own, bundled = (log.read(path, outputs).frame for path in (made, FOLDER / "dive.bin"))
    assert own.equals(bundled), "run `python datasets/make_logs.py`"
    assert own["RCOU.C1"].drop_nulls().len() == len(whole.pulses.t)
    assert np.diff(whole.pulses.t)[0] == pytest.approx(1.0 / MIXED)


def test_the_folder_is_small() -> None:
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 3_000_000
