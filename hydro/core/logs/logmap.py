"""Map of the columns of a log, which defines its conversion to a raw table.

These structs are both the map in memory and the validator of the TOML file; `io.logmap` reads and writes it.
Each block states its columns, unit and frame.  No block inherits settings from another, since logs mix
conventions: a compass in NED with a position in ENU is common.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

World = Literal["NED", "ENU", "NWU"]
Body = Literal["FRD", "FLU"]
Positive = Annotated[float, msgspec.Meta(gt=0)]


class _Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A table of the map file: unknown keys are errors, so that a misspelt name is never ignored."""


class Column(_Part, frozen=True):
    """Column of the log; the value of a cell is `scale` times the number in the log plus `offset`.

    The unit of the map applies afterwards.
    """

    column: str
    scale: float = 1.0
    offset: float = 0.0


class Command(Column, frozen=True):
    """Command column of a thruster.

    `reverse` if a positive command drives the thruster against its direction.
    """

    reverse: bool = False


Number = str | Column
"""Column given by its name, or with scale and offset."""


class Valid(_Part, frozen=True, rename={"differs": "not"}):
    """Condition for a valid sample; by default `column` must not be 0.

    Without `column` the condition applies to the quantity's own columns, as logged: `{not = -32.768}`.
    """

    column: str | None = None
    equals: float | None = None
    above: float | None = None
    below: float | None = None
    differs: float | None = None


Condition = str | Valid
"""Column that is not 0 for a valid sample, or a condition."""


class _Sensor(_Part, frozen=True, kw_only=True):
    """Common options of sensors and commands.

    `valid`: conditions for a sample to count; other samples are empty cells.  `per`: a column by which each
    value is divided.  `lag` [s]: time from the sample to its stamp.  `even`: the stamps are receive times of
    a periodic topic; by default detected by their bursts.
    """

    valid: Condition | tuple[Condition, ...] = ()
    per: Number | None = None
    lag: float = 0.0
    even: bool | None = None


class Mount(_Part, frozen=True):
    """Mounting of a sensor in the vehicle.

    `roll`, `pitch`, `yaw` [deg] rotate the sensor's axes to the body's, as an attitude rotates the body's to
    the world's (ZYX); `matrix` gives the same rotation row by row.  Both refer to axes forward, right, down,
    after `frame` is applied.  `position` [m] is the place from the body origin in FRD.
    """

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    matrix: tuple[tuple[float, ...], ...] | None = None
    position: tuple[float, ...] = (0.0, 0.0, 0.0)


class Time(_Part, frozen=True):
    """Clock of a log: numbers since any epoch, or text like `2025-06-01T12:00:00.25Z` (unit `iso`).

    `longest_step` [s]: longest silence of a channel that is interpolated; a longer one is a gap.  The default
    is five median steps of the channel.
    """

    column: str
    unit: Literal["s", "ms", "us", "ns", "iso"] = "s"
    longest_step: Positive | None = None


class Session(_Part, frozen=True):
    """Division of a log into sessions.

    Sessions are the values of a column, or one session with a `name`.  A session is also split where no
    sample arrives for `gap` [s].
    """

    column: str | None = None
    name: str | None = None
    gap: Positive | None = None


class Position(_Sensor, frozen=True):
    """Position of the body origin: three columns along the axes of `world`, or two and a depth or height.

    Two columns are the horizontal axes in the order of `world` (NED: north, east; ENU: east, north).  `depth`
    is positive down, `height` positive up, both from the water's surface; either may be given without
    columns.  `latitude` and `longitude` [deg] with a depth or height replace two columns: they become metres
    north and east of a session's first fix.
    """

    columns: tuple[Number, ...] = ()
    world: World = "NED"
    unit: Literal["m", "cm", "mm"] = "m"
    depth: Number | None = None
    height: Number | None = None
    latitude: Number | None = None
    longitude: Number | None = None


class Attitude(_Sensor, frozen=True):
    """Attitude of the axes `body` in the axes `world`: either Euler angles, or a quaternion.

    `columns` are roll, pitch and yaw (rotations about x, y, z).  `order` names the rotations from world to
    body: ZYX rotates by yaw, then about the new y by pitch, then about the new x by roll.  `quaternion` are
    four columns in the order of `layout`, which rotate vectors as given by `turns`.

    `mount` is for a sensor at an angle to the vehicle: it rotates the sensor's axes to the body's.  The
    columns are then the attitude of the sensor, and `body` names the sensor's own axes (FRD: its forward,
    right, down).
    """

    columns: tuple[Number, ...] | None = None
    unit: Literal["rad", "deg"] = "rad"
    order: Literal["ZYX", "XYZ", "YXZ", "ZXY", "XZY", "YZX"] = "ZYX"
    quaternion: tuple[Number, ...] | None = None
    layout: Literal["wxyz", "xyzw"] = "wxyz"
    turns: Literal["body to world", "world to body"] = "body to world"
    world: World = "NED"
    body: Body = "FRD"
    mount: Mount | None = None


class Velocity(_Sensor, frozen=True):
    """Velocity over ground, along body axes or world axes.

    It is the velocity of the body origin, or with `mount` that of a sensor.  A velocity along world axes is
    rotated to the body.  `held` states whether readings that repeat the one before are dropped; by default
    they are if many do.
    """

    columns: tuple[Number, ...]
    frame: Literal["FRD", "FLU", "NED", "ENU", "NWU"] = "FRD"
    unit: Literal["m/s", "cm/s", "mm/s", "kn"] = "m/s"
    mount: Mount | None = None
    held: bool | None = None


class Rates(_Sensor, frozen=True, rename={"source": "from"}):
    """Angular velocity about the body's axes x, y, z (a gyroscope's, not the rates of Euler angles).

    With `from = "attitude"` and no columns, the rates are slopes of local parabolas through the attitude's
    samples over `window` [s], by default the time of five samples.
    """

    columns: tuple[Number, ...] = ()
    frame: Body = "FRD"
    unit: Literal["rad/s", "deg/s"] = "rad/s"
    mount: Mount | None = None
    source: Literal["columns", "attitude"] = "columns"
    window: Positive | None = None


class PulseWidths(_Part, frozen=True):
    """Pulse widths [us] of a speed controller: full astern (`min`), rest (`neutral`), full ahead (`max`)."""

    min: Positive = 1100.0
    neutral: Positive = 1500.0
    max: Positive = 1900.0


class Commands(_Sensor, frozen=True):
    """Commands of the thrusters in the order of the vehicle file: -1 to 1, percent, or pulse widths.

    `off`: meaning of NaN and of a pulse width of 0, which disarmed autopilots write: "stop" is zero thrust,
    "hold" the last thrust before.
    """

    columns: tuple[str | Command, ...]
    unit: Literal["1", "percent", "pwm"] = "1"
    pwm: PulseWidths = PulseWidths()
    off: Literal["stop", "hold"] = "stop"


class Voltage(_Sensor, frozen=True):
    """Supply voltage of the thrusters; each row has the last reading at or before it."""

    column: Number
    unit: Literal["V", "mV"] = "V"


Demand = Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]


class Mixer(_Part, frozen=True):
    """Mixer of axis demands to thruster commands.

    `demands` names the axis of each command column, positive along or about the body's axes (SNAME: heave
    down).  Without `preset` and `matrix`, each demand is the command of a virtual thruster: the vehicle file
    has a thruster with a `wrench` for each of them, in this order.  `preset` is a frame of ArduSub; `matrix`
    has a row for each thruster and a column for each demand.  `directions` reverses thrusters: 1 or -1, as
    ArduSub's MOT_n_DIRECTION.
    """

    demands: tuple[Demand, ...]
    preset: Literal["ardusub_vectored", "ardusub_vectored_6dof"] | None = None
    matrix: tuple[tuple[float, ...], ...] | None = None
    directions: tuple[Literal[1, -1], ...] = ()


class Use(_Part, frozen=True, rename={"start": "from", "stop": "to"}):
    """Part of a session to use, `from` and `to` in seconds since its start; by default of every session."""

    session: str | None = None
    start: float = 0.0
    stop: float | None = None


class Table(_Part, frozen=True):
    """One table of a recording that consists of several files or topics, each with its own clock.

    `files` is a pattern of file names, in which `{session}` is the name of the session.  `time` is the column
    of the table's clock, with its `unit`.  With `name`, other parts of the map call the table's columns
    NAME.COLUMN.
    """

    files: str
    time: str
    unit: Literal["s", "ms", "us", "ns", "iso"] = "s"
    name: str | None = None


class LogMap(_Part, frozen=True, kw_only=True):
    """Content of a map file: the meaning of a log's columns.

    Position, attitude, velocity and rates are optional, one block for each sensor of the log.
    """

    time: Time = Time("time")
    position: Position | None = None
    attitude: Attitude | None = None
    velocity: Velocity | None = None
    rates: Rates | None = None
    commands: Commands
    voltage: Voltage | None = None
    session: Session = Session()
    mixer: Mixer | None = None
    use: Use | tuple[Use, ...] = ()
    table: tuple[Table, ...] = ()
    format: Literal["hydro-map/1"] = "hydro-map/1"


Block = Position | Attitude | Velocity | Rates
Sensor = Block | Commands | Voltage
BLOCKS = ("position", "attitude", "velocity", "rates")


def named(source: Number) -> Column:
    """Return a column that a map names, as a `Column`; a name alone means scale 1 and offset 0."""
    return source if isinstance(source, Column) else Column(source)


def command(source: str | Command) -> Command:
    """Return the command column of a thruster; a name alone means a column that is not reversed."""
    return source if isinstance(source, Command) else Command(source)


def conditions(given: Condition | tuple[Condition, ...]) -> tuple[Valid, ...]:
    """Return the conditions under which a sample of a sensor is valid.

    Args:
        given: Condition or conditions of the map; the name of a column alone means that it must not be 0.
    """
    every = given if isinstance(given, tuple) else (given,)
    return tuple(one if isinstance(one, Valid) else Valid(one) for one in every)


def stretches(given: LogMap) -> tuple[Use, ...]:
    """Return the parts of sessions that a map selects for the import; empty if the whole log is used."""
    return given.use if isinstance(given.use, tuple) else (given.use,)


def beside(block: Sensor) -> tuple[str, ...]:
    """Return the names of columns that a sensor block uses in addition to those of its values.

    They are the columns of `valid` (validity of samples) and `per` (divisor).
    """
    found = [one.column for one in conditions(block.valid) if one.column is not None]
    return (*found, *([named(block.per).column] if block.per is not None else []))


def blocks_of(given: LogMap) -> dict[str, Block]:
    """Return the blocks of pose and velocity that a map contains, by name, such as `position`."""
    every: dict[str, Block | None] = {name: getattr(given, name) for name in BLOCKS}
    return {name: block for name, block in every.items() if block is not None}


def sensors_of(given: LogMap) -> dict[str, Sensor]:
    """Return the sensor blocks of a map by name: pose and velocity, `commands`, and `voltage` if any."""
    found: dict[str, Sensor] = {**blocks_of(given), "commands": given.commands}
    return found if given.voltage is None else {**found, "voltage": given.voltage}


def measured(block: Block) -> tuple[Column, ...]:
    """Return the columns of a block's values with scale and offset, in the block's order.

    Args:
        block: Block of pose or velocity of a map.
    """
    taken: list[Number] = list(block.columns or ())
    if isinstance(block, Attitude):
        taken += block.quaternion or ()
    if isinstance(block, Position):
        every = (block.latitude, block.longitude, block.depth, block.height)
        taken += [source for source in every if source is not None]
    return tuple(named(source) for source in taken)


def columns_of(block: Sensor) -> list[str]:
    """Return the names of the columns of a sensor's values."""
    if isinstance(block, Commands):
        return [command(source).column for source in block.columns]
    if isinstance(block, Voltage):
        return [named(block.column).column]
    return [source.column for source in measured(block)]
