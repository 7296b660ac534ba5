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


class Position(_Part, frozen=True):
    """Position of the body origin: three columns along the axes of `world`, or two and a depth or height.

    Two columns are the horizontal axes in the order of `world` (NED: north, east; ENU: east, north).  `depth`
    is positive down, `height` positive up, both from the water's surface; without columns it stands alone.
    """

    columns: tuple[Number, ...] = ()
    world: World = "NED"
    unit: Literal["m", "cm", "mm"] = "m"
    depth: Number | None = None
    height: Number | None = None


class Attitude(_Part, frozen=True):
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


class Velocity(_Part, frozen=True):
    """Velocity of the body origin over ground: along the body's axes, or along the world's to be rotated."""

    columns: tuple[Number, ...]
    frame: Literal["FRD", "FLU", "NED", "ENU", "NWU"] = "FRD"
    unit: Literal["m/s", "cm/s", "mm/s", "kn"] = "m/s"


class Rates(_Part, frozen=True):
    """Angular velocity about the body's axes x, y, z (a gyroscope's, not the rates of Euler angles)."""

    columns: tuple[Number, ...]
    frame: Body = "FRD"
    unit: Literal["rad/s", "deg/s"] = "rad/s"


class PulseWidths(_Part, frozen=True):
    """Pulse widths [us] of full astern, of rest, and of full ahead."""

    min: Positive = 1100.0
    neutral: Positive = 1500.0
    max: Positive = 1900.0


class Commands(_Part, frozen=True):
    """Commands of the thrusters in the order of the vehicle file: -1 to 1, percent, or pulse widths."""

    columns: tuple[str | Command, ...]
    unit: Literal["1", "percent", "pwm"] = "1"
    pwm: PulseWidths = PulseWidths()


class LogMap(_Part, frozen=True, kw_only=True):
    """A map file; of position, attitude, velocity and rates those that the log has sensors for."""

    time: Time
    position: Position | None = None
    attitude: Attitude | None = None
    velocity: Velocity | None = None
    rates: Rates | None = None
    commands: Commands
    session: Session = Session()
    format: Literal["hydro-map/1"] = "hydro-map/1"


Block = Position | Attitude | Velocity | Rates
BLOCKS = ("position", "attitude", "velocity", "rates")


def named(source: Number) -> Column:
    """A column by its name alone is that column with scale 1 and offset 0."""
    return source if isinstance(source, Column) else Column(source)


def command(source: str | Command) -> Command:
    """A thruster's column by its name alone is one that is not reversed."""
    return source if isinstance(source, Command) else Command(source)


def blocks_of(given: LogMap) -> dict[str, Block]:
    """The blocks of pose and velocity that a map has, by name."""
    every: dict[str, Block | None] = {name: getattr(given, name) for name in BLOCKS}
    return {name: block for name, block in every.items() if block is not None}


def measured(block: Block) -> tuple[Column, ...]:
    """The columns that a block of pose or velocity takes, in its own order."""
    taken: list[Number] = list(block.columns or ())
    if isinstance(block, Attitude):
        taken += block.quaternion or ()
    if isinstance(block, Position):
        taken += [source for source in (block.depth, block.height) if source is not None]
    return tuple(named(source) for source in taken)
