"""Alternative meanings of the columns of a log: other frames, units, orders and signs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import msgspec

from hydro.core.logs.logmap import (
    BLOCKS,
    Block,
    Column,
    LogMap,
    Number,
    Position,
    Rates,
    Velocity,
    blocks_of,
    measured,
    named,
)

WORLDS = ("NED", "ENU", "NWU")
BODIES = ("FRD", "FLU")
FLIP_COST = 1.5  # cost of a reversed column in settings: exchanged frames are more usual
EXCHANGE_COST = 2.0  # cost of two exchanged columns of a block
RARE = 0.1  # extra cost of NWU over ENU; both fit, since a turn of world and heading is not observable


@dataclass(frozen=True)
class Change:
    """Change of one block of a map: settings replaced, one column reversed, or two columns exchanged.

    A block is the part of a map for one quantity, such as `velocity`.

    Attributes:
        block: Name of the block.
        settings: Replaced settings, as pairs of name and new value.
        flip: Number of the column to reverse, or None.
        exchange: Numbers of the columns to exchange, or None.
    """

    block: str
    settings: tuple[tuple[str, str], ...] = ()
    flip: int | None = None
    exchange: tuple[int, int] | None = None

    @property
    def cost(self) -> float:
        """Number of changed settings, weighted so that a more usual mistake costs less."""
        if self.flip is not None:
            return FLIP_COST
        if self.exchange is not None:
            return EXCHANGE_COST
        return len(self.settings) + RARE * sum(value == "NWU" for _, value in self.settings)

    def apply(self, given: LogMap) -> LogMap:
        """Return a copy of a map with this change."""
        block = getattr(given, self.block)
        if self.flip is not None:
            block = _flipped(block, self.flip)
        if self.exchange is not None:
            block = _exchanged(block, *self.exchange)
        return msgspec.structs.replace(
            given, **{self.block: msgspec.structs.replace(block, **dict(self.settings))}
        )

    def claim(self, declared: LogMap) -> str:
        """Return a clause on how the data contradict a map: `velocity looks FLU, not FRD as declared`.

        Args:
            declared: Map as declared.
        """
        block = getattr(declared, self.block)
        if self.flip is not None:
            return f"{self.block}: column {measured(block)[self.flip].column} looks reversed"
        if self.exchange is not None:
            return f"{self.block}: columns {' and '.join(self.columns(declared))} look exchanged"
        now = " and ".join(value for _, value in self.settings)
        then = " and ".join(getattr(block, key) for key, _ in self.settings)
        return f"{self.block} looks {now}, not {then} as declared"

    def advice(self, declared: LogMap) -> str:
        """Return a clause that tells how to correct the map file.

        Args:
            declared: Map as declared.
        """
        if self.exchange is not None:
            first, second = self.columns(declared)
            return f"write {second} in the place of {first} and {first} in that of {second} in {self.block}"
        if self.flip is None:
            return "set " + " and ".join(f'{self.block}.{key} = "{value}"' for key, value in self.settings)
        column = measured(getattr(declared, self.block))[self.flip]
        written = f'{{column = "{column.column}", scale = {-column.scale:g}}}'
        return f"write it as {written} in {self.block}" + (
            f" with offset = {-column.offset:g}" if column.offset else ""
        )

    def columns(self, declared: LogMap) -> tuple[str, ...]:
        """Return the names of the log's columns whose meaning the change alters.

        Args:
            declared: Map as declared.
        """
        taken = measured(getattr(declared, self.block))
        chosen = range(len(taken)) if self.flip is None else (self.flip,)
        return tuple(taken[i].column for i in self.exchange or chosen)


def frame_changes(declared: LogMap) -> dict[str, list[Change]]:
    """Return all changes of a map to other frames, units, orders and layouts, by the name of the block.

    One setting changes at a time.  The attitude's world and body also change together: ROS's ENU and FLU are
    easily mistaken for NED and FRD.

    Args:
        declared: Map of the log.
    """
    found: dict[str, list[Change]] = {name: [] for name in BLOCKS}
    for name, block in blocks_of(declared).items():
        changes = found[name]
        for key, values in _choices(block).items():
            others = [value for value in values if value != getattr(block, key)]
            changes += [Change(name, ((key, value),)) for value in others]
    turned = declared.attitude
    both = [
        Change("attitude", (("world", world), ("body", body)))
        for world in WORLDS
        for body in BODIES
        if turned is not None and world != turned.world and body != turned.body
    ]
    found["attitude"] += both
    return found


def flips(declared: LogMap) -> list[Change]:
    """Return one change for each column of pose and velocity that reverses the column's sign.

    Columns of a quaternion are left out.

    Args:
        declared: Map of the log.
    """
    found = []
    for name, block in blocks_of(declared).items():
        if getattr(block, "quaternion", None) is None:
            found += [Change(name, flip=i) for i in range(len(measured(block)))]
    return found


def exchanges(declared: LogMap) -> list[Change]:
    """Return one change for each pair of columns of a block that exchanges the two columns.

    Columns of a quaternion are left out.

    Args:
        declared: Map of the log.
    """
    return [
        Change(name, exchange=pair)
        for name, block in blocks_of(declared).items()
        for pair in combinations(range(len(block.columns or ())), 2)
    ]


def _choices(block: Block) -> dict[str, tuple[str, ...]]:
    """Return the tested values of each setting of a block, by the name of the setting."""
    if isinstance(block, Position):
        return {"world": WORLDS, "unit": ("m", "cm", "mm")}
    if isinstance(block, Velocity):
        return {"frame": (*BODIES, *WORLDS), "unit": ("m/s", "cm/s", "mm/s", "kn")}
    if isinstance(block, Rates):
        return {"frame": BODIES, "unit": ("rad/s", "deg/s")}
    own = {"layout": ("wxyz", "xyzw"), "turns": ("body to world", "world to body")}
    if block.quaternion is None:
        own = {"unit": ("rad", "deg"), "order": ("ZYX", "XYZ")}
    return {"world": WORLDS, "body": BODIES, **own}


def _flipped(block: Any, number: int) -> Any:
    """Return the block with the sign of one of its measured columns reversed."""
    columns = list(block.columns)
    if number < len(columns):
        columns[number] = _negated(columns[number])
        return msgspec.structs.replace(block, columns=tuple(columns))
    key = "depth" if block.depth is not None else "height"
    return msgspec.structs.replace(block, **{key: _negated(getattr(block, key))})


def _exchanged(block: Any, first: int, second: int) -> Any:
    """Return the block with two of its columns exchanged."""
    columns = list(block.columns)
    columns[first], columns[second] = columns[second], columns[first]
    return msgspec.structs.replace(block, columns=tuple(columns))


def _negated(source: Number) -> Column:
    column = named(source)
    return Column(column.column, -column.scale, -column.offset)


def difference(declared: LogMap, found: LogMap) -> list[Change]:
    """Return the changes that turn one map into another.

    All settings of one block are one change; each reversed column and each pair of exchanged columns is a
    further change.

    Args:
        declared: The first map.
        found: The second map, with the same columns.
    """
    changes = []
    for name, was in blocks_of(declared).items():
        now = getattr(found, name)
        settings = [
            (key, getattr(now, key)) for key in _choices(was) if getattr(now, key) != getattr(was, key)
        ]
        if settings:
            changes.append(Change(name, tuple(settings)))
        scales = {column.column: column.scale for column in measured(now)}
        before = enumerate(measured(was))
        changes += [Change(name, flip=i) for i, one in before if one.scale != scales[one.column]]
        changes += [Change(name, exchange=pair) for pair in _exchanges_to(was, now)]
    return changes


def _exchanges_to(was: Block, now: Block) -> list[tuple[int, int]]:
    """Return the sequence of exchanges from the columns of one block to those of another."""
    columns = [named(source).column for source in was.columns or ()]
    pairs = []
    for i, wanted in enumerate(named(source).column for source in now.columns or ()):
        if (k := columns.index(wanted, i)) != i:
            columns[i], columns[k] = columns[k], columns[i]
            pairs.append((i, k))
    return pairs


def cost(declared: LogMap, found: LogMap) -> float:
    """Return the number of settings in which two maps differ, weighted so that a usual mistake costs less.

    Args:
        declared: The first map.
        found: The second map, with the same columns.
    """
    return sum(change.cost for change in difference(declared, found))
