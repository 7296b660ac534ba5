"""Terms that a wrench on a vehicle may have: an axis and a product of velocities, commands or where down is.

They are what drag, lift and friction of bodies in water are made of (Fossen 2011, section 6.4, with powers
left free), what weight, trim and steady pulls add, and what jets and fins do that obey a command.  Powers of
a grid stand for those between them until a fit moves them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Any

from hydro.core.columns import VELOCITY
from hydro.core.effects.formula import AXES, one_term
from hydro.core.effects.layout import COMMAND_NAMES

OWN_POWERS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
OTHER_POWERS = (1.0, 1.5, 2.0, 2.5)
SIZE_POWERS = (0.5, 1.0, 2.0)
AHEAD_POWERS = (1.0, 2.0)
"""Of the speed ahead, with which a command's force grows: a jet's loss so, a fin's lift as its square."""
DOWN = ("g_x", "g_y", "g_z")
MIRRORED = frozenset("YKNvpr")
"""Axes and velocities that change sign in a mirror that swaps port and starboard, and g_y."""
PLAIN, UNUSUAL, UNEVEN = 1.0, 0.95, 0.8
"""How far a term is preferred: drag along an axis; what couples axes; what a hull that is the same on port
and starboard cannot have."""


@dataclass(frozen=True)
class Term:
    """A candidate.

    Attributes:
        text: As a vehicle file writes it, see `effects.formula`.
        powers: Where its free powers begin.
        preferred: Factor on what it gains, at most 1.
    """

    text: str
    powers: tuple[float, ...] = ()
    preferred: float = UNUSUAL

    @property
    def axis(self) -> int:
        """Axis of the wrench."""
        return AXES.index(self.text[0])

    def table(self, amount: float) -> dict[str, Any]:
        """The `[[effect]]` table of a formula of this term alone."""
        return one_term(self.text, amount, self.powers)


def library(commands: int = 0) -> list[Term]:
    """All candidates, axis by axis; each term stands there once for each power that it begins from.

    Args:
        commands: Number of the vehicle's thrusters and servos.
    """
    names = COMMAND_NAMES[:commands]
    return [term for axis in AXES for term in (*of_axis(axis), *of_commands(axis, names))]


def of_commands(axis: str, names: Sequence[str]) -> Iterator[Term]:
    """Candidates of one axis that go with a command."""
    for name in names:
        yield Term(f"{axis} {name}")
        yield Term(f"{axis} |{name}|^n sgn({name})", (2.0,))
        for power in AHEAD_POWERS:
            yield Term(f"{axis} |u|^n {name}", (power,))


def of_axis(axis: str) -> Iterator[Term]:
    """Candidates of one axis that go with the motion or with where down is."""
    own = VELOCITY[AXES.index(axis)]
    for power in OWN_POWERS:
        yield Term(f"{axis} |{own}|^n sgn({own})", (power,), PLAIN)
    for name in VELOCITY:
        if name != own:
            for power in OTHER_POWERS:
                yield even(Term(f"{axis} |{name}|^n sgn({name})", (power,)), name)
    for name in VELOCITY:
        for power in SIZE_POWERS:
            yield even(Term(f"{axis} |{name}|^n", (power,)))
    for one, other in permutations(VELOCITY, 2):
        yield even(Term(f"{axis} |{one}|^n {other}", (1.0,)), other)
    for one, other in combinations(VELOCITY, 2):
        yield even(Term(f"{axis} {one} {other}"), one, other)
    yield even(Term(axis))
    for name in DOWN:
        yield even(Term(f"{axis} {name}"), *("v" if name == "g_y" else ""))


def even(term: Term, *odd: str) -> Term:
    """The term, less preferred where its factors, odd in some velocities, turn otherwise than its axis."""
    turns = sum(name in MIRRORED for name in odd) % 2
    uneven = turns != (term.text[0] in MIRRORED)
    return Term(term.text, term.powers, UNEVEN if uneven else term.preferred)
