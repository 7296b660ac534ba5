"""What the columns of somebody's log mean: the map that turns a log into a raw table.

These structs are both the map in memory and the validator of the TOML file; `io.logmap` reads and writes it.
Each block says in its own words which columns it takes, in which unit and frame; nothing is taken for granted
between blocks, for logs mix conventions: a compass in NED beside a position in ENU is common.
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
    """A column of the log; its number is `scale` times what stands there plus `offset`, before any unit."""

    column: str
    scale: float = 1.0
    offset: float = 0.0


class Command(Column, frozen=True):
    """The column of a thruster; `reverse` where a positive command drives it against its direction."""

    reverse: bool = False


Number = str | Column
"""A column by its name alone, or with scale and offset."""


class Valid(_Part, frozen=True, rename={"differs": "not"}):
    """When a sample counts: what a column says of it, by default that it is not 0.

    Without `column` the quantity's own columns are asked, as logged: `{not = -32.768}`.
    """

    column: str | None = None
    equals: float | None = None
    above: float | None = None
    below: float | None = None
    differs: float | None = None


Condition = str | Valid
"""A column that is not 0 where a sample is valid, or what it must be."""


class _Sensor(_Part, frozen=True, kw_only=True):
    """What every sensor, and the commands, may say of their samples.

    `valid`: the conditions under which a sample counts; others are empty cells.  `per`: a column by which
    each value is divided.  `lag` [s]: the samples were taken that long before their stamp.  `even`: the
    stamps are receive times of a topic that was sent at even steps; by default found from their bursts.
    """

    valid: Condition | tuple[Condition, ...] = ()
    per: Number | None = None
    lag: float = 0.0
    even: bool | None = None


class Mount(_Part, frozen=True):
    """How a sensor sits in the vehicle.

    `roll`, `pitch`, `yaw` [deg] turn its axes into the body's, as an attitude turns the body's into the
    world's (ZYX); or `matrix` does, row by row.  Both are of axes forward, right, down, after `frame`.
    `position` [m] is its place from the body origin in FRD.
    """

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    matrix: tuple[tuple[float, ...], ...] | None = None
    position: tuple[float, ...] = (0.0, 0.0, 0.0)


class Time(_Part, frozen=True):
    """The clock: numbers since any epoch, or text like `2025-06-01T12:00:00.25Z` (unit `iso`).

    `longest_step` [s]: silence of a channel up to which it is interpolated, beyond which there is a gap; by
    default five of the channel's own usual steps.
    """

    column: str
    unit: Literal["s", "ms", "us", "ns", "iso"] = "s"
    longest_step: Positive | None = None


class Session(_Part, frozen=True):
    """Which rows belong together: by a column or all by one `name`; parted where time stops for `gap` [s]."""

    column: str | None = None
    name: str | None = None
    gap: Positive | None = None


class Position(_Sensor, frozen=True):
    """Position of the body origin: three columns along the axes of `world`, or two and a depth or height.

    Two columns are the horizontal axes in the order of `world` (NED: north, east; ENU: east, north).  `depth`
    is positive down, `height` positive up, both from the water's surface; without columns it stands alone.
    `latitude` and `longitude` [deg], beside a depth or height, take the place of two columns: they become
    metres north and east of a session's first fix.
    """

    columns: tuple[Number, ...] = ()
    world: World = "NED"
    unit: Literal["m", "cm", "mm"] = "m"
    depth: Number | None = None
    height: Number | None = None
    latitude: Number | None = None
    longitude: Number | None = None


class Attitude(_Sensor, frozen=True):
    """Attitude of the axes `body` in the axes `world`: Euler angles, or a quaternion.

    `columns` are roll, pitch and yaw (turns about x, y, z) whose `order` names the turns from the world
    inward: ZYX turns by yaw, then about the new y by pitch, then about the new x by roll.  `quaternion` are
    four columns in the order of `layout`, that turn vectors as `turns` says.
    """

    columns: tuple[Number, ...] | None = None
    unit: Literal["rad", "deg"] = "rad"
    order: Literal["ZYX", "XYZ", "YXZ", "ZXY", "XZY", "YZX"] = "ZYX"
    quaternion: tuple[Number, ...] | None = None
    layout: Literal["wxyz", "xyzw"] = "wxyz"
    turns: Literal["body to world", "world to body"] = "body to world"
    world: World = "NED"
    body: Body = "FRD"


class Velocity(_Sensor, frozen=True):
    """Velocity over ground: along the body's axes, or along the world's to be rotated.

    Of the body origin, or of a sensor elsewhere in the body where `mount` says so.  `held`: a reading that
    repeats the last one is no reading; by default so where many do.
    """

    columns: tuple[Number, ...]
    frame: Literal["FRD", "FLU", "NED", "ENU", "NWU"] = "FRD"
    unit: Literal["m/s", "cm/s", "mm/s", "kn"] = "m/s"
    mount: Mount | None = None
    held: bool | None = None


class Rates(_Sensor, frozen=True, rename={"source": "from"}):
    """Angular velocity about the body's axes x, y, z (a gyroscope's, not the rates of Euler angles).

    Or, with `from = "attitude"` and no columns, the slope of local parabolas through the attitude's samples
    over `window` [s], by default of the time of five samples.
    """

    columns: tuple[Number, ...] = ()
    frame: Body = "FRD"
    unit: Literal["rad/s", "deg/s"] = "rad/s"
    mount: Mount | None = None
    source: Literal["columns", "attitude"] = "columns"
    window: Positive | None = None


class PulseWidths(_Part, frozen=True):
    """Pulse widths [us] of full astern, of rest, and of full ahead."""

    min: Positive = 1100.0
    neutral: Positive = 1500.0
    max: Positive = 1900.0


class Commands(_Sensor, frozen=True):
    """Commands of the thrusters in the order of the vehicle file: -1 to 1, percent, or pulse widths.

    `off`: what NaN and a pulse width of 0 mean, which autopilots write while they are disarmed: "stop" is no
    thrust, "hold" the last thrust before.
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
    """What the commands are where they are demands of axes, one each, and what becomes of them.

    `demands` names the axis of each command column, positive along or about the body's axes (SNAME: heave
    down).  Alone they are the commands of virtual thrusters, which the vehicle file gives a `wrench` each in
    this order.  With `preset`, a frame of ArduSub, or with `matrix`, a row for each thruster and a column for
    each demand, they become the thrusters' own.  `directions` reverses thrusters: 1 or -1, as ArduSub's
    MOT_n_DIRECTION.
    """

    demands: tuple[Demand, ...]
    preset: Literal["ardusub_vectored", "ardusub_vectored_6dof"] | None = None
    matrix: tuple[tuple[float, ...], ...] | None = None
    directions: tuple[Literal[1, -1], ...] = ()


class Use(_Part, frozen=True, rename={"start": "from", "stop": "to"}):
    """A stretch to use [s] since the start of a `session`, or of each without a stretch of its own."""

    session: str | None = None
    start: float = 0.0
    stop: float | None = None


class Table(_Part, frozen=True):
    """One of several files or topics that make a recording, each with its own clock.

    `files` is a pattern of file names, in which `{session}` stands for what names the session; `time` the
    column of its clock, with `unit`.  With `name`, its columns are called NAME.COLUMN in the other tables.
    """

    files: str
    time: str
    unit: Literal["s", "ms", "us", "ns", "iso"] = "s"
    name: str | None = None


class LogMap(_Part, frozen=True, kw_only=True):
    """A map file; of position, attitude, velocity and rates those that the log has sensors for."""

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
    """A column by its name alone is that column with scale 1 and offset 0."""
    return source if isinstance(source, Column) else Column(source)


def command(source: str | Command) -> Command:
    """A thruster's column by its name alone is one that is not reversed."""
    return source if isinstance(source, Command) else Command(source)


def conditions(given: Condition | tuple[Condition, ...]) -> tuple[Valid, ...]:
    """The conditions of a sensor; a column alone must not be 0."""
    every = given if isinstance(given, tuple) else (given,)
    return tuple(one if isinstance(one, Valid) else Valid(one) for one in every)


def stretches(given: LogMap) -> tuple[Use, ...]:
    """The stretches to use; none where all is."""
    return given.use if isinstance(given.use, tuple) else (given.use,)


def beside(block: Sensor) -> tuple[str, ...]:
    """Columns that a sensor takes beside its values: those that say which are valid, and divisors."""
    found = [one.column for one in conditions(block.valid) if one.column is not None]
    return (*found, *([named(block.per).column] if block.per is not None else []))


def blocks_of(given: LogMap) -> dict[str, Block]:
    """The blocks of pose and velocity that a map has, by name."""
    every: dict[str, Block | None] = {name: getattr(given, name) for name in BLOCKS}
    return {name: block for name, block in every.items() if block is not None}


def sensors_of(given: LogMap) -> dict[str, Sensor]:
    """The blocks of pose and velocity that a map has, the commands, and the voltage if any, by name."""
    found: dict[str, Sensor] = {**blocks_of(given), "commands": given.commands}
    return found if given.voltage is None else {**found, "voltage": given.voltage}


def measured(block: Block) -> tuple[Column, ...]:
    """The columns that a block of pose or velocity takes, in its own order."""
    taken: list[Number] = list(block.columns or ())
    if isinstance(block, Attitude):
        taken += block.quaternion or ()
    if isinstance(block, Position):
        every = (block.latitude, block.longitude, block.depth, block.height)
        taken += [source for source in every if source is not None]
    return tuple(named(source) for source in taken)


def columns_of(block: Sensor) -> list[str]:
    """The columns of a sensor's values."""
    if isinstance(block, Commands):
        return [command(source).column for source in block.columns]
    if isinstance(block, Voltage):
        return [named(block.column).column]
    return [source.column for source in measured(block)]
