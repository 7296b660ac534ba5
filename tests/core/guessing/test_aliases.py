"""What the names of columns suggest."""

from __future__ import annotations

import pytest

from hydro.core.errors import DataError
from hydro.core.guessing.aliases import guess

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
        (["GyroX_dps", "GyroY_dps", "GyroZ_dps"], "rates",
         {"columns": ["GyroX_dps", "GyroY_dps", "GyroZ_dps"], "unit": "deg/s"}),
        (["DVL_Vx_cms", "DVL_Vy_cms", "DVL_Vz_cms"], "velocity",
         {"columns": ["DVL_Vx_cms", "DVL_Vy_cms", "DVL_Vz_cms"], "unit": "cm/s"}),
        (["Thr1_pct", "Thr2_pct"], "commands", {"columns": ["Thr1_pct", "Thr2_pct"], "unit": "percent"}),
        (["servo2_raw", "servo1_raw", "servo10_raw"], "commands",
         {"columns": ["servo1_raw", "servo2_raw", "servo10_raw"], "unit": "pwm"}),
        (["thruster1_pct", "thruster2_pct"], "commands",
         {"columns": ["thruster1_pct", "thruster2_pct"], "unit": "percent"}),
        (["imu.roll", "imu.pitch", "imu.yaw"], "attitude",
         {"columns": ["imu.roll", "imu.pitch", "imu.yaw"]}),
        (["u", "v"], "velocity", None),
        (["max", "box", "prex"], "position", None),
    ],
)  # fmt: skip
def test_names_of_loggers(names, block, expected):
    assert guess(names).get(block) == expected


def test_a_clock_of_text_is_one_of_timestamps():
    assert guess(["timestamp"], frozenset(["timestamp"]))["time"] == {"column": "timestamp", "unit": "iso"}


@pytest.mark.parametrize(
    "names",
    [
        ["rc_roll", "rc_pitch", "rc_yaw"],
        ["roll_cmd", "pitch_cmd", "yaw_cmd"],
        ["cmd_roll", "cmd_pitch", "cmd_yaw"],
        ["ATT.DesRoll", "ATT.DesPitch", "ATT.DesYaw"],
        ["setpoint.roll", "setpoint.pitch", "setpoint.yaw"],
    ],
)
def test_what_is_wanted_is_never_taken_for_what_was_measured(names):
    assert "attitude" not in guess(names)
    measured = ["roll_rad", "pitch_rad", "yaw_rad"]
    for order in ([*names, *measured], [*measured, *names]):
        assert guess(order)["attitude"] == {"columns": measured}


ODOMETRY = "/mavros/local_position/odom"
LOGGERS = {
    "mavros": (
        [
            *(f"{ODOMETRY}.pose.pose.position.{axis}" for axis in "xyz"),
            *(f"{ODOMETRY}.pose.pose.orientation.{axis}" for axis in "xyzw"),
            *(f"{ODOMETRY}.twist.twist.{kind}.{axis}" for kind in ("linear", "angular") for axis in "xyz"),
            *(f"/mavros/rc/in.channels[{i}]" for i in range(18)),
            *(f"/mavros/rc/out.channels[{i}]" for i in range(16)),
        ],
        {"position": "ENU", "attitude": "FLU", "velocity": "FLU", "rates": "FLU"},
        "/mavros/rc/out.channels[0]",
    ),
    "ardusub": (
        [
            *(f"XKF1[{core}].{name}" for core in (1, 0) for name in ["PN", "PE", "PD", "VN", "VE", "VD"]),
            *(f"ATT.{kind}{name}" for name in ("Roll", "Pitch", "Yaw") for kind in ("Des", "")),
            *(f"IMU[0].Gyr{axis}" for axis in "XYZ"),
            *(f"RCIN.C{i}" for i in range(1, 17)),
            *(f"RCOU.C{i}" for i in range(1, 15)),
        ],
        {"velocity": "NED"},
        "RCOU.C1",
    ),
    "blueos": (
        [
            *(f"LOCAL_POSITION_NED.{name}" for name in ["x", "y", "z", "vx", "vy", "vz"]),
            *(f"ATTITUDE.{name}{end}" for end in ("", "speed") for name in ("roll", "pitch", "yaw")),
            *(f"RC_CHANNELS.chan{i}_raw" for i in range(1, 19)),
            *(f"SERVO_OUTPUT_RAW.servo{i}_raw" for i in range(1, 17)),
        ],
        {"velocity": "NED"},
        "SERVO_OUTPUT_RAW.servo1_raw",
    ),
}


@pytest.mark.parametrize("name", LOGGERS)
def test_known_loggers_are_read_by_their_own_names(name):
    columns, frames, first = LOGGERS[name]
    for preset in (None, name):
        found = guess(["time", *columns], preset=preset)
        assert set(found) == {"time", "position", "attitude", "velocity", "rates", "commands"}
        for block, frame in frames.items():
            assert frame in found[block].values()
        assert found["commands"]["unit"] == "pwm"
        assert found["commands"]["columns"][0] == first
        assert len(found["commands"]["columns"]) == 8
        assert "XKF1[1].PN" not in found["position"]["columns"]


def test_a_preset_of_another_logger_is_refused():
    with pytest.raises(DataError, match="no column is called as a log of px4 calls them"):
        guess(RAW, preset="px4")


def test_servo_outputs_are_pulse_widths_of_thrusters():
    names = [f"servo{i}_raw" for i in range(1, 17)]
    assert guess(names)["commands"] == {"columns": names[:8], "unit": "pwm"}


def test_an_angular_velocity_is_no_velocity() -> None:
    names = [f"field.{what}.{axis}" for what in ("velocity", "angular_velocity") for axis in "xyz"]
    blocks = guess(names)
    assert blocks["velocity"]["columns"] == names[:3]
    assert blocks["rates"]["columns"] == names[3:]
    assert "velocity" not in guess(names[3:])
