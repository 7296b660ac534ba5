"""What else the columns of a log could have meant: other frames, units, orders and signs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec

from hydro.core.logs.logmap import (
    Attitude,
    Column,
    LogMap,
    Number,
    Position,
    Rates,
    Velocity,
    measured,
    named,
)

Block = Position | Attitude | Velocity | Rates
BLOCKS = ("position", "attitude", "velocity", "rates")
WORLDS = ("NED", "ENU", "NWU")
BODIES = ("FRD", "FLU")
FLIP_COST = 1.5  # of reversing one column, in settings: to exchange frames is the more usual mistake
RARE = 0.1  # more for NWU than for ENU, where both fit: they differ by a turn of world and heading alike


@dataclass(frozen=True)
class Change:
    """Another reading of one block: some settings replaced, or one column reversed.

    Attributes:
        block: Name of the block.
        settings: New values by the name of the setting.
        flip: Number of the column to reverse, or None.
    """

    block: str
    settings: tuple[tuple[str, str], ...] = ()
    flip: int | None = None

    @property
    def cost(self) -> float:
        """How far it is from what was declared, in settings; between equals the usual one is nearer."""
        rare = sum(value == "NWU" for _, value in self.settings)
        return len(self.settings) + RARE * rare if self.flip is None else FLIP_COST

    def apply(self, given: LogMap) -> LogMap:
        """The map with this change."""
        block = getattr(given, self.block)
        if self.flip is not None:
            block = _flipped(block, self.flip)
        return msgspec.structs.replace(
            given, **{self.block: msgspec.structs.replace(block, **dict(self.settings))}
        )

    def claim(self, declared: LogMap) -> str:
        """What the data look like, in words: `velocity looks FLU, not FRD as declared`."""
        block = getattr(declared, self.block)
        if self.flip is not None:
            return f"{self.block}: column {measured(block)[self.flip].column} looks reversed"
        now = " and ".join(value for _, value in self.settings)
        then = " and ".join(getattr(block, key) for key, _ in self.settings)
        return f"{self.block} looks {now}, not {then} as declared"

    def advice(self, declared: LogMap) -> str:
        """What to write into the map."""
        if self.flip is None:
            return "set " + " and ".join(f'{self.block}.{key} = "{value}"' for key, value in self.settings)
        column = measured(getattr(declared, self.block))[self.flip]
        written = f'{{column = "{column.column}", scale = {-column.scale:g}}}'
        return f"write it as {written} in {self.block}" + (
            f" with offset = {-column.offset:g}" if column.offset else ""
        )


def frame_changes(declared: LogMap) -> dict[str, list[Change]]:
    """Other frames, units, orders and layouts of each block, one setting at a time.

    The attitude's world and body also change together: ROS's ENU and FLU are easily taken for NED and FRD.
    """
    found: dict[str, list[Change]] = {name: [] for name in BLOCKS}
    for name, changes in found.items():
        block = getattr(declared, name)
        for key, values in _choices(block).items():
            others = [value for value in values if value != getattr(block, key)]
            changes += [Change(name, ((key, value),)) for value in others]
    both = [
        Change("attitude", (("world", world), ("body", body)))
        for world in WORLDS
        for body in BODIES
        if world != declared.attitude.world and body != declared.attitude.body
    ]
    found["attitude"] += both
    return found


def flips(declared: LogMap) -> list[Change]:
    """Each column of pose and velocity reversed, but a quaternion's: nobody mistakes one sign of those."""
    found = []
    for name in BLOCKS:
        block = getattr(declared, name)
        if name != "attitude" or declared.attitude.quaternion is None:
            found += [Change(name, flip=i) for i in range(len(measured(block)))]
    return found


def _choices(block: Block) -> dict[str, tuple[str, ...]]:
    """What could have been meant by each setting of a block."""
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
    """The block with one of its measured columns negated."""
    columns = list(block.columns)
    if number < len(columns):
        columns[number] = _negated(columns[number])
        return msgspec.structs.replace(block, columns=tuple(columns))
    key = "depth" if block.depth is not None else "height"
    return msgspec.structs.replace(block, **{key: _negated(getattr(block, key))})


def _negated(source: Number) -> Column:
    column = named(source)
    return Column(column.column, -column.scale, -column.offset)


def difference(declared: LogMap, found: LogMap) -> list[Change]:
    """What leads from one map to another: per block its settings in one change, and every reversed column."""
    changes = []
    for name in BLOCKS:
        was, now = getattr(declared, name), getattr(found, name)
        settings = [
            (key, getattr(now, key)) for key in _choices(was) if getattr(now, key) != getattr(was, key)
        ]
        if settings:
            changes.append(Change(name, tuple(settings)))
        pairs = enumerate(zip(measured(was), measured(now), strict=True))
        changes += [Change(name, flip=i) for i, (before, after) in pairs if before.scale != after.scale]
    return changes


def cost(declared: LogMap, found: LogMap) -> float:
    """How far one map is from another, in settings."""
    return sum(change.cost for change in difference(declared, found))
