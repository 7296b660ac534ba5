"""Guess of the meaning of a log's columns by their names: a first map for its owner to correct.

Names of the raw table have priority, then those of loggers and papers.  Names are compared without case and
punctuation.  They may carry their unit (`roll_deg`) and a prefix (`/odom/pose/pose/position/x`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from hydro.core.guessing.presets import MOST_THRUSTERS, preset_blocks, vertical_block

Block = dict[str, Any]


class _Family(NamedTuple):
    """Names of a vector's columns, and their usual meaning."""

    names: tuple[str, ...]
    settings: Mapping[str, Any] = MappingProxyType({})


def _xyz(*stems: str, axes: str = "xyz", **settings: Any) -> list[_Family]:
    """Return families whose names are a stem and an axis."""
    return [_Family(tuple(stem + axis for axis in axes), settings) for stem in stems]


_ROS = {"world": "ENU", "body": "FLU"}
_POSITION = [
    *_xyz("pose_position_", world="ENU"),
    *_xyz("", "pos_", "pos", "position_", "p", "p_"),
    *_xyz("", "pos_", "pos", "p_", axes="ned"),
    *_xyz("", "pos_", "pos", "p_", axes="enu", world="ENU"),
    _Family(("north", "east", "down")),
    _Family(("east", "north", "up"), {"world": "ENU"}),
]
_FLAT = [
    *_xyz("", "pos_", "pos", "position_", "p", "p_", axes="xy"),
    _Family(("north", "east")),
    _Family(("northing", "easting")),
    _Family(("east", "north"), {"world": "ENU"}),
    _Family(("easting", "northing"), {"world": "ENU"}),
]
_GEODETIC = [
    _Family(("latitude", "longitude")),
    _Family(("lat", "lon")),
    _Family(("lat", "lng")),
]
_VERTICAL = {
    "depth": "depth",
    "height": "height",
    "elevation": "height",
    "rel_alt": "height",
    "relative_alt": "height",
    "relative_altitude": "height",
    "altituderelative": "height",
}
_PRESSURE = {"fluid_pressure": "Pa", "water_pressure": None, "press_abs": None, "pressure": None}
"""Names of the water's pressure, with the unit if a standard defines it."""
_PLACED = ("", "_m", "_data")
"""Suffixes of the name of a depth: a unit, or the field of a ROS message of one number."""
_ANGLES = [
    _Family(("phi", "theta", "psi")),
    _Family(("roll", "pitch", "yaw")),
    _Family(("roll", "pitch", "heading")),
    _Family(("att_r", "att_p", "att_y")),
]
_QUATERNIONS = [
    *_xyz("q", "q_", "quat_", "quaternion_", axes="wxyz", layout="wxyz"),
    *_xyz("q", "q_", axes="0123", layout="wxyz"),
    *_xyz("orientation_", axes="xyzw", layout="xyzw", **_ROS),
]
_VELOCITY = [
    _Family(("u", "v", "w")),
    _Family(("surge", "sway", "heave")),
    *_xyz("v", "v_", "vel_", "vel", "velocity_", "dvl_", "dvl_v", "dvlv", "dvl"),
    *_xyz("linear_", "linear_velocity_", frame="FLU"),
    *_xyz("v", "v_", "vel_", "velocity_", axes="ned", frame="NED"),
    *_xyz("v", "v_", "vel_", "velocity_", axes="enu", frame="ENU"),
]
_RATES = [
    _Family(("p", "q", "r")),
    *_xyz("w", "w_", "g", "omega_", "gyro_", "gyro", "gyr_", "gyr", "rate_"),
    *_xyz("angular_", "angular_velocity_", frame="FLU"),
    _Family(("rollspeed", "pitchspeed", "yawspeed")),
    _Family(("roll_rate", "pitch_rate", "yaw_rate")),
    _Family(("rollrate", "pitchrate", "yawrate")),
]
_LENGTHS = {"": "m", "_m": "m", "_cm": "cm", "_mm": "mm"}
_TURNS = {"": "rad", "_rad": "rad", "_deg": "deg", "_degrees": "deg"}
_SPEEDS = {
    "": "m/s",
    "_m_s": "m/s",
    "_mps": "m/s",
    "_cm_s": "cm/s",
    "_cms": "cm/s",
    "_mm_s": "mm/s",
    "_kn": "kn",
}
_SPINS = {"": "rad/s", "_rad_s": "rad/s", "_rps": "rad/s", "_deg_s": "deg/s", "_dps": "deg/s"}
_CLOCK = re.compile(r"(?:t|time|timestamp|stamp|clock|elapsed|datetime|utc|time_boot)(?:_?(s|sec|ms|us|ns))?")
_CLOCK_UNITS = {None: "s", "sec": "s"}
_SESSION = ("session", "run", "dive", "mission", "trial", "episode")
_COMMAND = re.compile(
    r"(cmd|command|u|thruster|thrust|thr|motor|servo|pwm|rcout|rcou_c|ch|channel|output|esc|t)_?(\d+)"
    r"((?:_(?:raw|pwm|us|pct|percent|out|cmd|command))*)"
)
_LONG_COMMAND = re.compile(
    r"(.+)_(cmd|command|thruster|motor|servo|pwm|rcout|channels|setpoint|setpoints|control|output)_?(\d+)"
    r"((?:_(?:raw|pwm|us|pct|percent|out|cmd|command))*)"
)
"""Commands after the name of a message, where a short stem is ambiguous."""
_ROW_OF_THRUSTERS = re.compile(
    r"(?:.+_)?(thrusters?|motors?|servos?|pwm|escs?)"
    r"((?:_(?:data|input|inputs|values?|cmd|commands?|setpoints?|pwm|us|raw|out|outputs?|controls?|channels|thrust))*)"
    r"_(\d+)"
)
"""Array in a message whose name contains thrusters."""
_VOLTAGE = re.compile(
    r"(?:(?:.+_)?(?:battery|batt|bat|supply|bus)_?(?:voltage|volt|volts|v)|voltage|v_?bat|v_?batt|vbus)(?:_(v|mv))?"
)
"""Supply voltage; voltages of a single cell or of a payload are excluded."""
_STICKS = re.compile(
    r"(^|_)(rc_?in|rc_channels(_raw|_scaled|_override)?|rc_override|manual_control|joy|joystick)(_|$)"
)
"""Messages of a pilot's sticks, which do not drive thrusters."""
_WORDS = (
    "rc cmd command commanded set setpoint setpoints sp ref reference target goal joy joystick "
    "manual demand demanded input control ctrl controller override pilot stick servo pwm output "
    "error err innov std var cov covariance bias"
)
_WANTED = frozenset(_WORDS.split())
"""Words in names of demanded or derived quantities, which are not measured."""
_DESIRED = re.compile(r"des(?!c|k)|tgt")
_PULSED = ("servo", "pwm", "rcout", "rcou_c", "ch", "channel", "channels", "esc")


def guess(
    names: Sequence[str],
    texts: frozenset[str] = frozenset(),
    preset: str | None = None,
    thrusters: int | None = None,
) -> dict[str, Block]:
    """Return the blocks of a log's map, guessed from the names of its columns.

    A block says which columns hold one quantity, in which frame and unit.  Names of a known logger have
    priority.  Commanded or demanded quantities (`rc_roll`, `roll_cmd`, `DesYaw`) are never mistaken for
    measurements.

    Args:
        names: The log's columns.
        texts: Columns of text; a clock among them has ISO timestamps.
        preset: Name of a logger in `presets.PRESETS`; by default the one whose column names match best.
        thrusters: Number of thrusters; by default the number of columns named like commands, at most eight.

    Returns:
        Blocks by name, as in a map file; blocks without matching names are missing.  A depth by pressure has
        a key `pressure`, its unit, which `refining.refined` resolves.

    Raises:
        DataError: No column has a name of the given preset.
    """
    plain = {re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_"): name for name in reversed(names)}
    measured = {name: column for name, column in plain.items() if not _is_wanted(name)}
    found = {
        "time": _time(plain, texts),
        "session": _session(plain),
        "position": _position(measured),
        "attitude": _attitude(measured),
        "velocity": _vector(_without_turns(measured), _VELOCITY, _SPEEDS),
        "rates": _vector(measured, _RATES, _SPINS),
        "commands": _commands(plain, thrusters),
        "voltage": _voltage(measured),
    }
    _, known = preset_blocks(names, preset)
    found.update(known)
    if thrusters is not None and (driven := found["commands"]) is not None:
        found["commands"] = {**driven, "columns": driven["columns"][:thrusters]}
    return {name: block for name, block in found.items() if block is not None}


def _without_turns(plain: dict[str, str]) -> dict[str, str]:
    """Return the columns without angular velocities."""
    return {name: column for name, column in plain.items() if "angular" not in name.split("_")}


def _is_wanted(name: str) -> bool:
    """Return whether a name denotes a demanded or derived quantity, not a measurement."""
    words = name.split("_")
    return bool(_WANTED.intersection(words)) or any(_DESIRED.match(word) for word in words)


def _voltage(plain: dict[str, str]) -> Block | None:
    """Return the first column with a name of a supply voltage."""
    for name, column in reversed(plain.items()):
        if match := _VOLTAGE.fullmatch(name):
            return {"column": column, "unit": "mV"} if match[1] == "mv" else {"column": column}
    return None


def _time(plain: dict[str, str], texts: frozenset[str]) -> Block | None:
    """Return the clock, and its unit by the end of its name."""
    for name, column in reversed(plain.items()):
        if match := _CLOCK.fullmatch(name):
            unit = "iso" if column in texts else _CLOCK_UNITS.get(match[1], match[1])
            return {"column": column, "unit": unit} if unit != "s" else {"column": column}
    return None


def _session(plain: dict[str, str]) -> Block | None:
    return next(({"column": plain[name]} for name in _SESSION if name in plain), None)


def _position(plain: dict[str, str]) -> Block | None:
    """Return three columns, or two and a depth or height, which has priority over a z; or these alone."""
    vertical = next(
        (
            (key, plain[name + suffix])
            for name, key in _VERTICAL.items()
            for suffix in ("", "_m")
            if name + suffix in plain
        ),
        None,
    )
    flat = _vector(plain, _FLAT, {"": "m", "_m": "m"})
    if vertical is not None and flat is not None:
        return {**flat, vertical[0]: vertical[1]}
    if (block := _vector(plain, _POSITION, _LENGTHS)) is not None:
        return block
    alone = _depth(plain)
    globe = _vector(plain, _GEODETIC, {"": "deg", "_deg": "deg"})
    if globe is not None and alone is not None:
        latitude, longitude = globe["columns"]
        return {"latitude": latitude, "longitude": longitude, **alone}
    return alone


def _depth(plain: dict[str, str]) -> Block | None:
    """Return the first column with a name of a depth, a height or a pressure, also after a prefix."""
    kinds = {**_VERTICAL, **dict.fromkeys(_PRESSURE, "pressure")}
    for name, kind in kinds.items():
        for suffix in _PLACED:
            for own, column in reversed(plain.items()):
                if own == name + suffix or own.endswith(f"_{name}{suffix}"):
                    unit = {"pressure": _PRESSURE[name]} if kind == "pressure" else {}
                    return vertical_block(column, kind, unit)
    return None


def _attitude(plain: dict[str, str]) -> Block | None:
    if (block := _vector(plain, _QUATERNIONS, {"": ""})) is not None:
        return {"quaternion": block.pop("columns"), **block}
    return _vector(plain, _ANGLES, _TURNS)


def _vector(plain: dict[str, str], families: Sequence[_Family], units: dict[str, str]) -> Block | None:
    """Return the first complete family, by its names alone or after one common prefix."""
    for family, suffix in ((family, suffix) for family in families for suffix in units):
        wanted = [name + suffix for name in family.names]
        for prefix in _prefixes(plain, wanted[0]):
            columns = [plain.get(prefix + name) for name in wanted]
            if None not in columns:
                unit = {"unit": units[suffix]} if units[suffix] and units[suffix] != units[""] else {}
                return {"columns": columns, **unit, **family.settings}
    return None


def _prefixes(plain: dict[str, str], first: str) -> Iterator[str]:
    """Yield the possible prefixes of a family's names; short names get none, since many names end in x."""
    yield ""
    if len(first) > 3:
        yield from (name.removesuffix(first) for name in plain if name.endswith(f"_{first}"))


def _commands(plain: dict[str, str], thrusters: int | None) -> Block | None:
    """Return the longest row of numbered columns with a name of a thruster's command.

    A row with the vehicle's number of thrusters has priority over longer ones.
    """
    rows: dict[tuple[str, str, str], dict[int, str]] = {}
    for name, column in plain.items():
        if _STICKS.search(name):
            continue
        if match := _COMMAND.fullmatch(name):
            rows.setdefault(("", match[1], match[3]), {})[int(match[2])] = column
        elif match := _LONG_COMMAND.fullmatch(name):
            rows.setdefault((match[1], match[2], match[4]), {})[int(match[3])] = column
        elif match := _ROW_OF_THRUSTERS.fullmatch(name):
            row = (name.removesuffix(f"_{match[3]}"), match[1], match[2])
            rows.setdefault(row, {})[int(match[3])] = column
    if not rows:
        return None
    (_, stem, ending), numbered = max(
        rows.items(),
        key=lambda row: (len(row[1]) == thrusters, len(row[1]), row[0][0] == "", row[0][1] == "cmd"),
    )
    pulsed = stem in _PULSED or re.search("_(raw|pwm|us)", ending) is not None
    first = sorted(numbered)[:MOST_THRUSTERS]
    taken = (
        first if pulsed and first == list(range(first[0], first[0] + MOST_THRUSTERS)) else sorted(numbered)
    )
    block: Block = {"columns": [numbered[number] for number in taken]}
    if pulsed:
        return {**block, "unit": "pwm"}
    return {**block, "unit": "percent"} if re.search("_(pct|percent)", ending) else block
