"""Assignment of command columns to thrusters, with the sign of each thruster."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hydro.core.columns import Array, command_column


@dataclass(frozen=True)
class Wiring:
    """Assignment: the command column that drives each thruster, and the thruster's direction.

    Attributes:
        column: For each thruster, the index of its command column, from 0.
        sign: For each thruster, 1, or -1 if the thruster pushes opposite to the file.
    """

    column: tuple[int, ...]
    sign: tuple[int, ...]

    @classmethod
    def plain(cls, count: int) -> Wiring:
        """Return the assignment of the vehicle file: column i drives thruster i, for `count` thrusters."""
        return cls(tuple(range(count)), (1,) * count)

    @property
    def is_plain(self) -> bool:
        """Whether this is the assignment of the vehicle file."""
        return self == Wiring.plain(len(self.column))

    @property
    def reversed(self) -> tuple[int, ...]:
        """Indices of the thrusters with the file's column that push opposite to the file, from 0."""
        return tuple(i for i, drive in enumerate(self.drives()) if drive == (i, -1))

    @property
    def moved(self) -> tuple[int, ...]:
        """Indices of the thrusters that another column than the file's drives, from 0."""
        return tuple(i for i, column in enumerate(self.column) if column != i)

    def drives(self) -> Iterator[tuple[int, int]]:
        """Return an iterator over pairs, one per thruster: index of its command column, and sign 1 or -1."""
        return zip(self.column, self.sign, strict=True)

    def exchanges(self) -> Iterator[tuple[int, ...]]:
        """Yield, for each exchange of two thrusters' columns, the new column indices of all n thrusters."""
        for i, k in combinations(range(len(self.column)), 2):
            changed = list(self.column)
            changed[i], changed[k] = changed[k], changed[i]
            yield tuple(changed)

    def simpler(self) -> Iterator[Wiring]:
        """Yield new assignments that differ from the file in one sign, or one exchange of columns, less."""
        for i, sign in enumerate(self.sign):
            if sign < 0:
                yield Wiring(self.column, (*self.sign[:i], 1, *self.sign[i + 1 :]))
        for i in self.moved:
            k = self.column.index(i)  # thruster i gets its own column, and thruster k the one of i
            changed = list(self.column)
            changed[i], changed[k] = i, self.column[i]
            yield Wiring(tuple(changed), self.sign)

    def apply(self, commands: Array) -> Array:
        """Return a new array of logged commands in the order and with the signs that the file expects.

        Args:
            commands: Commands of n columns in N rows, (N, n).

        Returns:
            Commands of the n thrusters, (N, n).
        """
        return np.ascontiguousarray(commands[:, list(self.column)] * np.array(self.sign, float))

    def columns(self) -> tuple[str, ...]:
        """Return the sorted names of command columns that differ from the file in thruster or sign."""
        drives = enumerate(self.drives())
        return tuple(
            sorted(command_column(column) for i, (column, sign) in drives if (column, sign) != (i, 1))
        )

    def words(self) -> str:
        """Return the differences from the file in words, such as `minus cmd_4 drives thruster 4`."""
        changed = [
            f"{'minus ' if sign < 0 else ''}{command_column(column)} drives thruster {i + 1}"
            for i, (column, sign) in enumerate(self.drives())
            if (column, sign) != (i, 1)
        ]
        return ", ".join(changed)
