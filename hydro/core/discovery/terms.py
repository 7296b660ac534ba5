"""Library of candidate terms: a wrench axis and a product of velocities, commands or gravity direction.

The terms cover drag, lift and friction of bodies in water (Fossen 2011, section 6.4, with free powers),
weight, trim and steady forces, and jets and fins that follow a command.  A grid of powers gives the initial
values; a fit changes the powers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Any

from hydro.core.columns import VELOCITY
from hydro.core.diagnosis.settings import NEARLY_EQUAL
from hydro.core.effects.formula import AXES, one_term
from hydro.core.effects.layout import COMMAND_NAMES

OWN_POWERS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)  # initial powers of the velocity along the axis
OTHER_POWERS = (1.0, 1.5, 2.0, 2.5)  # initial powers of another velocity, with its sign
SIZE_POWERS = (0.5, 1.0, 2.0)  # initial powers of a velocity without its sign
AHEAD_POWERS = (1.0, 2.0)
"""Powers of surge speed in the force of a command: about 1 for the thrust loss of a jet, 2 for the lift of a
fin.
"""
DOWN = ("g_x", "g_y", "g_z")
MIRRORED = frozenset("YKNvpr")
"""Axes and velocities that change sign when port and starboard are swapped; so does g_y."""


@dataclass(frozen=True)
class Term:
    """Candidate term.

    Attributes:
        text: The term as written in a vehicle file, see `effects.formula`.
        powers: Initial values of the free powers n.
        preferred: Factor on the error that the term removes when terms are ranked, at most 1.
    """

    text: str
    powers: tuple[float, ...] = ()
    preferred: float = 1.0

    @property
    def axis(self) -> int:
        """Axis of the wrench on which the term acts, 0 to 5."""
        return AXES.index(self.text[0])

    def table(self, amount: float) -> dict[str, Any]:
        """Return the `[[effect]]` table of a formula of this term alone, with a coefficient `amount`."""
        return one_term(self.text, amount, self.powers)


def library(commands: int = 0) -> list[Term]:
    """Return all candidate terms, axis by axis; a term with a free power appears once per initial power."""
    names = COMMAND_NAMES[:commands]
    return [term for axis in AXES for term in (*of_axis(axis), *of_commands(axis, names))]


def of_commands(axis: str, names: Sequence[str]) -> Iterator[Term]:
    """Yield the candidate terms of one wrench axis that depend on a command."""
    for name in names:
        yield Term(f"{axis} {name}")
        yield Term(f"{axis} |{name}|^n sgn({name})", (2.0,))
        for power in AHEAD_POWERS:
            yield Term(f"{axis} |u|^n {name}", (power,))


def of_axis(axis: str) -> Iterator[Term]:
    """Yield the candidate terms of a wrench axis (X Y Z K M N) that depend on motion or gravity direction."""
    own = VELOCITY[AXES.index(axis)]
    for power in OWN_POWERS:
        yield Term(f"{axis} |{own}|^n sgn({own})", (power,))
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
    """Return a term, with a lower preference if port-starboard symmetry of the hull rules it out.

    `odd` are the velocities or gravity components in the term that change its sign.
    """
    turns = sum(name in MIRRORED for name in odd) % 2
    uneven = turns != (term.text[0] in MIRRORED)
    return Term(term.text, term.powers, NEARLY_EQUAL if uneven else term.preferred)
