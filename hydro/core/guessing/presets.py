"""Presets for the columns of well-known loggers: quantity, frame and unit by message name.

A name matches the end of a column, after a slash, a dot or nothing, so that a vehicle's namespace may precede
it.  An index may be written `[0]` or `.0`.  The first complete source of a quantity is used: the estimate of
the vehicle's filter has priority over a single sensor.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from hydro.core.errors import DataError

Block = dict[str, Any]
MOST_THRUSTERS = 8
"""Default number of outputs used as thrusters: others are lights, grippers and mounts."""
LEAST_BLOCKS = 2
"""Minimum number of quantities with a preset's names for it to be selected automatically."""
SAME_QUANTITY = ("attitude", "velocity", "rates")
"""Quantities of which every source measures the same; sources of a position may have its depth only."""


class Source(NamedTuple):
    """Columns of one quantity in the logs of a known logger.

    Attributes:
        stem: Name of the columns, with `*` where they differ.
        parts: Replacements of `*`, one for each column.
        settings: Further keys of the quantity's block in a map, such as the unit.
    """

    stem: str
    parts: tuple[str, ...]
    settings: Mapping[str, Any] = MappingProxyType({})


ATMOSPHERE = 101_325.0
"""Standard pressure of the air [Pa]."""
WATER = 1000.0 * 9.80665
"""Pressure of a metre of fresh water [Pa]."""
PRESSURE_UNITS = {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "bar": 1e5}
"""Pascals in each unit of pressure."""


def depth_of_pressure(column: str, unit: str) -> Block:
    """Return the entry of a map that makes a depth [m] of a column with an absolute pressure.

    Args:
        column: Name of the column with the pressure.
        unit: Unit of the pressure, a key of PRESSURE_UNITS.

    Returns:
        A dict with the keys `column`, `scale` and `offset`.
    """
    return {"column": column, "scale": PRESSURE_UNITS[unit] / WATER, "offset": -ATMOSPHERE / WATER}


def _of(stem: str, parts: str | Sequence[str], **settings: Any) -> Source:
    return Source(stem, tuple(parts), settings)


def _ros(topic: str, world: str, body: str) -> dict[str, list[Source]]:
    """Return the fields of a nav_msgs/Odometry."""
    frames = {"world": world, "body": body}
    return {
        "position": [_of(f"{topic}.pose.pose.position.*", "xyz", world=world)],
        "attitude": [_of(f"{topic}.pose.pose.orientation.*", "xyzw", layout="xyzw", **frames)],
        "velocity": [_of(f"{topic}.twist.twist.linear.*", "xyz", frame=body)],
        "rates": [_of(f"{topic}.twist.twist.angular.*", "xyz", frame=body)],
    }


_INDICES = tuple(str(i) for i in range(MOST_THRUSTERS))
_NUMBERS = tuple(str(i + 1) for i in range(MOST_THRUSTERS))
_LOCAL = "mavros/local_position"
_FLU = {"world": "ENU", "body": "FLU"}
_ODOMETRY = _ros(f"{_LOCAL}/odom", "ENU", "FLU")
_ANGLES = ("roll", "pitch", "yaw")
_ONE = ("",)
_SPINS = ("rollspeed", "pitchspeed", "yawspeed")
_CORE = "XKF1"
_MAVLINK_KNOWS = {"not": 65535.0}
"""MAVLink's 16-bit value of an unknown voltage."""

PRESETS: dict[str, dict[str, list[Source]]] = {
    "mavros": {
        "position": [
            *_ODOMETRY["position"],
            _of(f"{_LOCAL}/pose.pose.position.*", "xyz", world="ENU"),
            _of("mavros/vfr_hud.altitude", _ONE, vertical="height"),
            _of("mavros/global_position/rel_alt.data", _ONE, vertical="height"),
        ],
        "attitude": [
            *_ODOMETRY["attitude"],
            _of(f"{_LOCAL}/pose.pose.orientation.*", "xyzw", layout="xyzw", **_FLU),
            _of("mavros/imu/data.orientation.*", "xyzw", layout="xyzw", **_FLU),
        ],
        "velocity": [
            *_ODOMETRY["velocity"],
            _of(f"{_LOCAL}/velocity_body.twist.linear.*", "xyz", frame="FLU"),
            _of(f"{_LOCAL}/velocity_local.twist.linear.*", "xyz", frame="ENU"),
        ],
        "rates": [*_ODOMETRY["rates"], _of("mavros/imu/data.angular_velocity.*", "xyz", frame="FLU")],
        "commands": [_of("mavros/rc/out.channels.*", _INDICES, unit="pwm")],
        "voltage": [_of("mavros/battery.voltage", _ONE)],
    },
    "ardusub": {
        "position": [
            _of(f"{_CORE}.P*", "NED"),
            _of("NKF1.P*", "NED"),
            _of("CTUN.Alt", _ONE, vertical="height"),
        ],
        "attitude": [
            _of("ATT.*", ("Roll", "Pitch", "Yaw"), unit="deg"),
            _of(f"{_CORE}.*", ("Roll", "Pitch", "Yaw"), unit="deg"),
        ],
        "velocity": [_of(f"{_CORE}.V*", "NED", frame="NED"), _of("NKF1.V*", "NED", frame="NED")],
        "rates": [_of("IMU.Gyr*", "XYZ")],
        "commands": [_of("RCOU.C*", _NUMBERS, unit="pwm")],
        "voltage": [_of("BAT.Volt", _ONE), _of("CURR.Volt", _ONE)],
    },
    "blueos": {
        "position": [
            _of("LOCAL_POSITION_NED.*", "xyz"),
            _of("VFR_HUD.alt", _ONE, vertical="height"),
            _of("GLOBAL_POSITION_INT.relative_alt", _ONE, vertical="height", unit="mm"),
            _of("SCALED_PRESSURE2.press_abs", _ONE, vertical="pressure", pressure="hPa"),
        ],
        "attitude": [_of("ATTITUDE.*", _ANGLES)],
        "velocity": [_of("LOCAL_POSITION_NED.v*", "xyz", frame="NED")],
        "rates": [_of("ATTITUDE.*", _SPINS)],
        "commands": [_of("SERVO_OUTPUT_RAW.servo*_raw", _NUMBERS, unit="pwm")],
        "voltage": [_of("SYS_STATUS.voltage_battery", _ONE, unit="mV", valid=_MAVLINK_KNOWS)],
    },
    "stonefish": {
        **_ros("odometry", "NED", "FRD"),
        "commands": [
            _of(f"{topic}.*", _INDICES)
            for topic in (
                "thruster_state.setpoint",
                "thruster_setpoints.data",
                "thrusters.data",
                "setpoint.data",
            )
        ],
    },
    "px4": {
        "position": [_of("vehicle_local_position.*", "xyz"), _of("vehicle_odometry.position.*", "012")],
        "attitude": [_of("vehicle_attitude.q.*", "0123"), _of("vehicle_odometry.q.*", "0123")],
        "velocity": [
            _of("vehicle_local_position.v*", "xyz", frame="NED"),
            _of("vehicle_odometry.velocity.*", "012", frame="NED"),
        ],
        "rates": [
            _of("vehicle_angular_velocity.xyz.*", "012"),
            _of("vehicle_odometry.angular_velocity.*", "012"),
        ],
        "commands": [
            _of("actuator_motors.control.*", _INDICES),
            _of("actuator_outputs.output.*", _INDICES, unit="pwm"),
        ],
        "voltage": [_of("battery_status.voltage_v", _ONE)],
    },
    "qgroundcontrol": {
        "position": [_of("altitudeRelative", _ONE, vertical="height")],
        "attitude": [_of("*", ("roll", "pitch", "heading"), unit="deg")],
        "rates": [_of("*Rate", _ANGLES, unit="deg/s")],
        "voltage": [_of("battery0.voltage", _ONE)],
    },
}
"""Column names of each kind of logger, by quantity, the preferred source first."""


def preset_blocks(names: Sequence[str], preset: str | None = None) -> tuple[str | None, dict[str, Block]]:
    """Return the name of the logger that a log's column names fit, and its blocks of a map by name.

    A block says which columns hold one quantity.  Name and blocks are None and empty where no logger fits.

    Args:
        names: The log's columns.
        preset: Name of a logger in PRESETS; by default the one with the most blocks, if it has at least two.

    Raises:
        DataError: No column has a name of the given preset.
    """
    found = {key: _blocks(names, PRESETS[key]) for key in ([preset] if preset is not None else PRESETS)}
    best = max(found, key=lambda key: len(found[key]))
    if preset is not None and not found[best]:
        raise DataError(
            f"no column is called as a log of {preset} calls them; leave --preset out, or try "
            f"{', '.join(key for key in PRESETS if key != preset)}"
        )
    if preset is None and len(found[best].keys() - {"voltage"}) < LEAST_BLOCKS:
        return None, {}
    return best, found[best]


def other_sources(names: Sequence[str], blocks: Mapping[str, Block]) -> list[tuple[str, Block]]:
    """Return further blocks for attitude, velocity and rates in a log of a known logger.

    A block says which columns hold one quantity.  A log may have the same quantity in several messages, for
    instance the attitude in a pose and in an IMU message.

    Args:
        names: The log's columns.
        blocks: Blocks of the log's map by name; quantities whose block is not that of the logger are skipped.

    Returns:
        Pairs of the quantity's name and a block of a map.
    """
    preset, known = preset_blocks(names)
    if preset is None:
        return []
    return [
        (quantity, block)
        for quantity in SAME_QUANTITY
        if quantity in known and blocks.get(quantity) == known[quantity]
        for source in PRESETS[preset].get(quantity, ())
        if (block := _block(names, quantity, source)) is not None and block != known[quantity]
    ]


def _blocks(names: Sequence[str], quantities: Mapping[str, Sequence[Source]]) -> dict[str, Block]:
    found = {}
    for quantity, sources in quantities.items():
        block = next((one for one in (_block(names, quantity, each) for each in sources) if one), None)
        if block is not None:
            found[quantity] = block
    return found


def _block(names: Sequence[str], quantity: str, source: Source) -> Block | None:
    """Return the block of one source; for thrusters, the contiguous ones that exist."""
    columns = [_column(names, source.stem, part) for part in source.parts]
    if quantity == "commands":
        columns = columns[: columns.index(None)] if None in columns else columns
    if not columns or None in columns:
        return None
    if quantity == "voltage":
        return {"column": columns[0], **source.settings}
    if quantity == "position" and len(columns) == 1:
        settings = dict(source.settings)
        return vertical_block(str(columns[0]), settings.pop("vertical"), settings)
    key = "quaternion" if quantity == "attitude" and len(columns) == 4 else "columns"
    return {key: columns, **source.settings}


def vertical_block(column: str, kind: str, settings: Mapping[str, Any]) -> Block:
    """Return the position block of a map for a log that has a depth alone.

    Args:
        column: Column of the depth, height or pressure.
        kind: `depth`, `height` or `pressure`.
        settings: Further keys of the block, such as the unit; they override those of the result.
    """
    if kind == "pressure":
        return {"depth": {"column": column}, "pressure": None, **settings}
    return {kind: column, **settings}


def _column(names: Sequence[str], stem: str, part: str) -> str | None:
    """Return the first column that ends with the stem, with its star replaced by a part.

    The name may contain an instance number, of which the first is used, and a level `message`.
    """
    wanted = stem.replace("*", part)
    for name in names:
        plain = re.sub(r"\.message\.", ".", re.sub(r"\[(\d+)\]", r".\1", name))
        for one in (plain, re.sub(r"\.0\.", ".", plain)):
            if one == wanted or one.endswith((f"/{wanted}", f".{wanted}")):
                return name
    return None
