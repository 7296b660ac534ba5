"""What the names of columns suggest."""

from __future__ import annotations

import pytest

from hydro.core.logs.aliases import guess

RAW = ["session", "t", "x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r", "cmd_1", "cmd_2"]


def test_the_raw_tables_own_names_are_that_table():
    assert guess(RAW) == {
        "time": {"column": "t"},
        "session": {"column": "session"},
        "position": {"columns": ["x", "y", "z"]},
        "attitude": {"columns": ["phi", "theta", "psi"]},
        "velocity": {"columns": ["u", "v", "w"]},
        "rates": {"columns": ["p", "q", "r"]},
        "commands": {"columns": ["cmd_1", "cmd_2"]},
    }


@pytest.mark.parametrize(
    ("names", "block", "expected"),
    [
        (["time_ms"], "time", {"column": "time_ms", "unit": "ms"}),
        (["TimeUS"], "time", {"column": "TimeUS", "unit": "us"}),
        (["Timestamp [s]"], "time", {"column": "Timestamp [s]"}),
        (["field.stamp"], "time", None),
        (["Roll_deg", "Pitch_deg", "Yaw_deg"], "attitude",
         {"columns": ["Roll_deg", "Pitch_deg", "Yaw_deg"], "unit": "deg"}),
        (["qw", "qx", "qy", "qz"], "attitude", {"quaternion": ["qw", "qx", "qy", "qz"], "layout": "wxyz"}),
        ([f"/odom/pose.orientation.{axis}" for axis in "xyzw"], "attitude",
         {"quaternion": [f"/odom/pose.orientation.{axis}" for axis in "xyzw"], "layout": "xyzw",
          "world": "ENU", "body": "FLU"}),
        ([f"/odom/pose.position.{axis}" for axis in "xyz"], "position",
         {"columns": [f"/odom/pose.position.{axis}" for axis in "xyz"], "world": "ENU"}),
        ([f"twist_linear_{axis}" for axis in "xyz"], "velocity",
         {"columns": [f"twist_linear_{axis}" for axis in "xyz"], "frame": "FLU"}),
        (["east_m", "north_m", "depth_m"], "position",
         {"columns": ["north_m", "east_m"], "depth": "depth_m"}),
        (["x", "y", "z", "Depth"], "position", {"columns": ["x", "y"], "depth": "Depth"}),
        (["v_n", "v_e", "v_d"], "velocity", {"columns": ["v_n", "v_e", "v_d"], "frame": "NED"}),
        (["vx_cm_s", "vy_cm_s", "vz_cm_s"], "velocity",
         {"columns": ["vx_cm_s", "vy_cm_s", "vz_cm_s"], "unit": "cm/s"}),
        (["gyro_x_dps", "gyro_y_dps", "gyro_z_dps"], "rates",
         {"columns": ["gyro_x_dps", "gyro_y_dps", "gyro_z_dps"], "unit": "deg/s"}),
        (["servo2_raw", "servo1_raw", "servo10_raw"], "commands",
         {"columns": ["servo1_raw", "servo2_raw", "servo10_raw"], "unit": "pwm"}),
        (["thruster1_pct", "thruster2_pct"], "commands",
         {"columns": ["thruster1_pct", "thruster2_pct"], "unit": "percent"}),
        (["u", "v"], "velocity", None),
        (["max", "box", "prex"], "position", None),
    ],
)  # fmt: skip
def test_names_of_loggers(names, block, expected):
    assert guess(names).get(block) == expected


def test_a_clock_of_text_is_one_of_timestamps():
    assert guess(["timestamp"], frozenset(["timestamp"]))["time"] == {"column": "timestamp", "unit": "iso"}
