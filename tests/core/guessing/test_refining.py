"""Guesses that need a look at the numbers, and angles that cannot be radians."""

from __future__ import annotations

import io
from pathlib import Path

import log_writers as writers
import numpy as np
import polars as pl
import pytest

import hydro
from hydro import cli
from hydro.core.errors import DataError
from hydro.core.guessing.aliases import guess
from hydro.core.guessing.refining import refined
from hydro.core.logs.conventions import in_degrees
from hydro.io import logmap

T = np.arange(400) * 0.05
FLAT = np.zeros(400)
SWING = np.sin(T)
FLUID = "sensor_msgs/msg/FluidPressure"


# Degrees


@pytest.mark.parametrize(
    ("roll", "pitch", "yaw", "expected"),
    [
        (SWING, SWING, 3.0 * SWING, False),
        (SWING, 10.0 * SWING, FLAT, True),
        (40.0 * SWING, SWING, FLAT + 3.0, True),
        (SWING, SWING, 180.0 + 4.0 * SWING, True),
        (SWING, SWING, (30.0 * T) % 360.0, True),
        (SWING, SWING, 1.5 * T, False),  # 30 rad: a yaw that counts turns
        (SWING, SWING, np.full(400, np.nan), False),
    ],
)
def test_angles_beyond_a_turn_are_degrees_unless_they_count_turns(roll, pitch, yaw, expected):
    assert in_degrees([roll, pitch, yaw]) is expected


def test_a_map_that_calls_degrees_radians_is_contradicted():
    """Also where no rates stand beside the attitude."""
    frame = pl.DataFrame({"t": T, "roll": SWING, "pitch": 20.0 * SWING, "yaw": FLAT, "c": SWING})
    text = '[time]\ncolumn = "t"\n[attitude]\ncolumns = ["roll", "pitch", "yaw"]\n'
    text += '[commands]\ncolumns = ["c"]\n'
    with pytest.raises(DataError, match=r'pitch reaches 20 rad .* set attitude.unit = "deg"'):
        hydro.import_log(io.BytesIO(frame.write_csv().encode()), logmap.parse(text), strict=True)


def test_a_guess_takes_angles_beyond_a_turn_for_degrees():
    names = ["roll", "pitch", "yaw"]
    values = dict(zip(names, (SWING, 20.0 * SWING, FLAT), strict=True))
    blocks, notes = refined(guess(names), values.get)
    assert blocks["attitude"]["unit"] == "deg"
    assert "taken for degrees" in notes[0]


def test_telemetry_of_qgroundcontrol():
    names = ["Timestamp", "roll", "pitch", "heading", "rollRate", "pitchRate", "yawRate", "altitudeRelative"]
    found = guess(names, frozenset(["Timestamp"]))
    assert found["attitude"] == {"columns": ["roll", "pitch", "heading"], "unit": "deg"}
    assert found["rates"] == {"columns": ["rollRate", "pitchRate", "yawRate"], "unit": "deg/s"}
    assert found["position"] == {"height": "altitudeRelative"}
    assert found["time"] == {"column": "Timestamp", "unit": "iso"}


# Commands


@pytest.mark.parametrize(
    "topic",
    ["/rov/thrusters.data", "/thruster_setpoints.data", "/motors", "/esc/pwm.channels", "/servo_cmd.values"],
)
def test_a_topic_that_says_thrusters_is_their_commands(topic):
    names = [f"{topic}[{i}]" for i in range(6)]
    other = [f"/imu/data.data[{i}]" for i in range(9)] + [f"{topic}_temperature[{i}]" for i in range(12)]
    assert guess([*other, *names])["commands"]["columns"] == names


def test_as_many_commands_as_the_vehicle_has_thrusters_go_first():
    six = [f"/thrusters.data[{i}]" for i in range(6)]
    eight = [f"/lights/pwm.data[{i}]" for i in range(8)]
    assert guess([*eight, *six], thrusters=6)["commands"]["columns"] == six
    assert guess([*eight], thrusters=6)["commands"]["columns"] == eight[:6]


@pytest.mark.parametrize(
    ("scale", "unit"), [((0.4, 0.0), None), ((40.0, 0.0), "percent"), ((300.0, 1500.0), "pwm")]
)
def test_the_unit_of_commands_by_their_numbers(scale, unit):
    names = [f"/thrusters.data[{i}]" for i in range(6)]
    blocks, _ = refined(guess(names), lambda name: scale[0] * SWING + scale[1])
    assert blocks["commands"].get("unit") == unit


@pytest.mark.parametrize("off", [0.0, 1100.0, np.nan])
def test_six_thrusters_among_eight_outputs(off):
    """The others are off, or lights at their lowest."""
    names = [f"servo{i}_raw" for i in range(1, 9)]
    values = {name: np.full(400, off if place > 5 else 1500.0) for place, name in enumerate(names)}
    blocks, notes = refined(guess(names), values.get)
    assert blocks["commands"]["columns"] == names[:6]
    assert "6 thrusters" in notes[-1]


# Depth


@pytest.mark.parametrize(
    ("names", "block"),
    [
        (["VFR_HUD.alt", "ATTITUDE.roll", "ATTITUDE.pitch", "ATTITUDE.yaw"], {"height": "VFR_HUD.alt"}),
        (["/mavros/global_position/rel_alt.data"], {"height": "/mavros/global_position/rel_alt.data"}),
        (["/bar30/depth.data"], {"depth": "/bar30/depth.data"}),
        (["depth_m"], {"depth": "depth_m"}),
    ],
)
def test_a_depth_alone_is_guessed(names, block):
    assert guess(["time", *names])["position"] == block


@pytest.mark.parametrize(
    ("name", "surface", "metre"),
    [
        ("/bar30.fluid_pressure", 101_325.0, 9806.65),
        ("pressure", 1013.25, 98.0665),
        ("water_pressure", 1.01325, 0.0980665),
    ],
)
def test_depth_follows_from_pressure_in_any_unit(name, surface, metre):
    depth = 2.0 - 2.0 * np.cos(T)
    blocks, notes = refined(guess([name]), lambda _: surface + metre * depth)
    found = blocks["position"]["depth"]
    np.testing.assert_allclose(found["scale"] * (surface + metre * depth) + found["offset"], depth, atol=1e-9)
    assert found["column"] == name
    assert "depth by the pressure" in notes[0]


def test_a_pressure_of_no_known_unit_is_no_depth():
    """A gauge's, which is 0 at the surface."""
    blocks, notes = refined(guess(["water_pressure"]), lambda _: 9806.65 * (2.0 + SWING))
    assert "position" not in blocks
    assert "its unit is not known" in notes[0]


# The whole way


def test_a_guess_goes_on_without_a_velocity_and_says_so(tmp_path: Path, capsys):
    messages = [
        writers.Message(topic, kind, round((1e9 + t) * 1e9), content)
        for t in T
        for topic, kind, content in (
            ("/bar30", FLUID, {"fluid_pressure": 101_325.0 + 9806.65 * (1.0 + np.sin(t))}),
            ("/rov/thrusters", "std_msgs/msg/Float64MultiArray", {"data": [1500.0 + 100.0 * np.sin(t)] * 6}),
        )
    ]
    path = writers.ros1(tmp_path / "dive.bag", messages, {}, "LZ4")
    assert cli.main(["import", str(path), "-o", str(tmp_path / "raw.parquet")]) == 0
    said = capsys.readouterr().err
    assert "no column name identifies attitude, velocity, rates" in said
    frame = pl.read_parquet(tmp_path / "raw.parquet")
    np.testing.assert_allclose(frame["z"], 1.0 + np.sin(frame["t"].to_numpy()), atol=0.02)
    np.testing.assert_allclose(frame["cmd_6"], 0.25 * np.sin(frame["t"].to_numpy()), atol=0.02)
    assert cli.main(["import", str(path), "--write-map", str(tmp_path / "map.toml")]) == 0
    found = logmap.parse((tmp_path / "map.toml").read_text())
    assert found.commands.unit == "pwm"
    assert found.position.depth.column == "/bar30.fluid_pressure"
