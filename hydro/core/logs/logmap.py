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
    """Column of a log as a map names it.

    The value of a cell is `scale` times the number in the log plus `offset`; the unit of the map applies
    afterwards.

    Attributes:
        column: Name of the column.
        scale: Factor of the numbers.
        offset: Number to add.
    """

    column: str
    scale: float = 1.0
    offset: float = 0.0


class Command(Column, frozen=True):
    """Command column of a thruster, as a map names it.

    Attributes:
        column: Name of the column.
        scale: Factor of the numbers.
        offset: Number to add.
        reverse: Whether a positive command drives the thruster against its direction.
    """

    reverse: bool = False


Number = str | Column
"""Column given by its name, or with scale and offset."""


class Valid(_Part, frozen=True, rename={"differs": "not"}):
    """Condition for a valid sample of a sensor; by default `column` must not be 0.

    Without `column` the condition applies to the quantity's own columns, as logged: `{not = -32.768}`.

    Attributes:
        column: Name of the column that is tested.
        equals: Number that the column must have.
        above: Number that the column must exceed.
        below: Number that the column must stay below.
        differs: Number that the column must not have (`not` in a map file).
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
    """Mounting of a sensor in the vehicle: rotation and place.

    The angles rotate the sensor's axes to the body's, as an attitude rotates the body's to the world's (ZYX).
    Both refer to axes forward, right, down, after `frame` is applied.

    Attributes:
        roll: Roll [deg].
        pitch: Pitch [deg].
        yaw: Yaw [deg].
        matrix: The same rotation as a matrix, row by row, instead of the angles; None without.
        position: Place of the sensor from the body origin, FRD [m].
    """

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    matrix: tuple[tuple[float, ...], ...] | None = None
    position: tuple[float, ...] = (0.0, 0.0, 0.0)


class Time(_Part, frozen=True):
    """Clock of a log, as a map describes it.

    Attributes:
        column: Name of the column with the times.
        unit: Unit of numbers since any epoch, or `iso` for text like `2025-06-01T12:00:00.25Z`.
        longest_step: Longest silence of a channel that is interpolated [s]; a longer silence is a gap.  The
            default is five median steps of the channel.
    """

    column: str
    unit: Literal["s", "ms", "us", "ns", "iso"] = "s"
    longest_step: Positive | None = None


class Session(_Part, frozen=True):
    """Division of a log into sessions, as a map describes it.

    Attributes:
        column: Name of a column whose values are the sessions; None for one session.
        name: Name of the only session.
        gap: Time without samples [s] at which a session is split; None for no split.
    """

    column: str | None = None
    name: str | None = None
    gap: Positive | None = None


class Position(_Sensor, frozen=True):
    """Position of the body origin in a log, as a map describes it.

    Given are three columns along the axes of `world`, or two columns and a depth or height, or a depth or
    height alone.  Latitude and longitude with a depth or height replace two columns: they become metres north
    and east of a session's first fix.

    Attributes:
        columns: Columns in the order of `world` (NED: north, east, down; ENU: east, north, up).
        world: Axes of the world.
        unit: Unit of columns, depth and height.
        depth: Column of the depth below the water's surface, positive down.
        height: Column of the height above the water's surface, positive up.
        latitude: Column of the latitude [deg].
        longitude: Column of the longitude [deg].
    """

    columns: tuple[Number, ...] = ()
    world: World = "NED"
    unit: Literal["m", "cm", "mm"] = "m"
    depth: Number | None = None
    height: Number | None = None
    latitude: Number | None = None
    longitude: Number | None = None


class Attitude(_Sensor, frozen=True):
    """Attitude in a log, as a map describes it: of the axes `body` in the axes `world`.

    Euler angles or a quaternion are given.

    Attributes:
        columns: Columns of roll, pitch and yaw (rotations about x, y, z); None with a quaternion.
        unit: Unit of the angles.
        order: Rotations from world to body: ZYX rotates by yaw, then about the new y by pitch, then about the
            new x by roll.
        quaternion: Four columns in the order of `layout`; None with angles.
        layout: Order of the quaternion's components.
        turns: Which vectors the quaternion rotates.
        world: Axes of the world.
        body: Axes of the body, or with `mount` the sensor's own axes (FRD: its forward, right, down).
        mount: Rotation from the sensor's axes to the body's, for a sensor at an angle to the vehicle; the
            columns are then the attitude of the sensor.
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
    """Velocity over ground in a log, as a map describes it, along body axes or world axes.

    A velocity along world axes is rotated to the body.

    Attributes:
        columns: Columns of the three components, in the order of `frame`.
        frame: Axes of the components.
        unit: Unit of the columns.
        mount: Place and rotation of the sensor; None for a velocity of the body origin in body axes.
        held: Whether readings that repeat the previous reading are dropped; by default they are dropped if
            many repeat.
    """

    columns: tuple[Number, ...]
    frame: Literal["FRD", "FLU", "NED", "ENU", "NWU"] = "FRD"
    unit: Literal["m/s", "cm/s", "mm/s", "kn"] = "m/s"
    mount: Mount | None = None
    held: bool | None = None


class Rates(_Sensor, frozen=True, rename={"source": "from"}):
    """Angular velocity in a log about the body's axes x, y, z (a gyroscope's), as a map describes it.

    These are not the rates of Euler angles.

    Attributes:
        columns: Columns of the three components, in the order of `frame`.
        frame: Axes of the components.
        unit: Unit of the columns.
        mount: Rotation of the sensor; None for body axes.
        source: `columns`; or `attitude` without columns (`from` in a map file): slopes of local parabolas
            through the attitude's samples.
        window: Duration of a parabola [s]; by default the time of five samples.
    """

    columns: tuple[Number, ...] = ()
    frame: Body = "FRD"
    unit: Literal["rad/s", "deg/s"] = "rad/s"
    mount: Mount | None = None
    source: Literal["columns", "attitude"] = "columns"
    window: Positive | None = None


class PulseWidths(_Part, frozen=True):
    """Pulse widths of a speed controller [us].

    Attributes:
        min: Pulse width of full thrust astern.
        neutral: Pulse width of rest.
        max: Pulse width of full thrust ahead.
    """

    min: Positive = 1100.0
    neutral: Positive = 1500.0
    max: Positive = 1900.0


class Commands(_Sensor, frozen=True):
    """Commands of the thrusters in a log, as a map describes them, in the order of the vehicle file.

    Attributes:
        columns: One column per thruster.
        unit: Unit of the columns: numbers from -1 to 1, percent, or pulse widths.
        pwm: Pulse widths of full astern, rest and full ahead.
        off: Meaning of NaN and of a pulse width of 0, which disarmed autopilots write: `stop` is zero thrust,
            `hold` the last thrust before.
    """

    columns: tuple[str | Command, ...]
    unit: Literal["1", "percent", "pwm"] = "1"
    pwm: PulseWidths = PulseWidths()
    off: Literal["stop", "hold"] = "stop"


class Voltage(_Sensor, frozen=True):
    """Supply voltage of the thrusters in a log; each row has the last reading at or before it.

    Attributes:
        column: Column of the voltage.
        unit: Unit of the column.
    """

    column: Number
    unit: Literal["V", "mV"] = "V"


Demand = Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]


class Mixer(_Part, frozen=True):
    """Mixer, which converts axis demands in a log to thruster commands.

    Without `preset` and `matrix`, each demand is the command of a virtual thruster: the vehicle file has a
    thruster with a `wrench` for each of them, in this order.

    Attributes:
        demands: Axis of each command column, positive along or about the body's axes (SNAME: heave down).
        preset: Name of a frame of ArduSub, which gives the matrix.
        matrix: Mixing matrix with a row for each thruster and a column for each demand.
        directions: 1 or -1 for each thruster, -1 to reverse it, as ArduSub's MOT_n_DIRECTION; () for all 1.
    """

    demands: tuple[Demand, ...]
    preset: Literal["ardusub_vectored", "ardusub_vectored_6dof"] | None = None
    matrix: tuple[tuple[float, ...], ...] | None = None
    directions: tuple[Literal[1, -1], ...] = ()


class Use(_Part, frozen=True, rename={"start": "from", "stop": "to"}):
    """Part of a session that is used for the import.

    Attributes:
        session: Name of the session; None for every session.
        start: Time since the start of the session [s], `from` in a map file.
        stop: Time since the start of the session [s], `to` in a map file; None for its end.
    """

    session: str | None = None
    start: float = 0.0
    stop: float | None = None


class Table(_Part, frozen=True):
    """One table of a recording that consists of several files or topics, each with its own clock.

    Attributes:
        files: Pattern of file names, in which `{session}` is the name of the session.
        time: Name of the column of the table's clock.
        unit: Unit of the clock.
        name: Name by which other parts of the map call the table's columns, NAME.COLUMN; None for none.
    """

    files: str
    time: str
    unit: Literal["s", "ms", "us", "ns", "iso"] = "s"
    name: str | None = None


class LogMap(_Part, frozen=True, kw_only=True):
    """Content of a map file: the meaning of a log's columns.

    Attributes:
        time: The clock.
        position: Block of the position sensor; None without.
        attitude: Block of the attitude sensor; None without.
        velocity: Block of the velocity sensor; None without.
        rates: Block of the gyroscope; None without.
        commands: Block of the thruster commands.
        voltage: Block of the supply voltage; None without.
        session: Division into sessions.
        mixer: Mixer of axis demands to thruster commands; None if the commands are those of thrusters.
        use: Parts of sessions to use; () for all.
        table: Tables with their own clocks; () for one table.
        format: Name and version of the format.
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
