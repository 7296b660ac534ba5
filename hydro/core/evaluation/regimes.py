"""Activity of a vehicle in every fifth of a second of a recording, in a pilot's words.

Errors are summed over such pieces of time.  Families of conditions classify the pieces: turning left or
right, a range of speed, a heading, a level of command.  The conditions follow from the recording and the
positions of the thrusters, never from a model's forces, so that two models are compared in the same places.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Rows
from hydro.core.evaluation.metrics import consecutive
from hydro.core.recording.arrays import HORIZONTAL, Recording
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation
from hydro.core.vehicle.thrusters import MAX_THRUST, configuration_matrix, thruster_table

PIECE_SECONDS = 0.2
"""Length of a piece [s]."""
BLOCK_SECONDS = 20.0
"""Length of the bootstrap blocks [s]; shorter where a recording has fewer than LEAST_DRAWN such blocks."""
LEAST_DRAWN = 8
"""Minimum number of blocks in a recording."""
HOVERING_SPEED = 0.1
"""Speed at or below which a vehicle hovers and its drift angle is undefined [m/s]."""
TILTED = math.radians(5.0)
"""Pitch or roll from which a vehicle counts as tilted [rad]."""
IDLE = 0.05
"""Command below which a thruster counts as off, as a share of full command."""
SHOWN_BY: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "turn": (("psi",), ("r",)),
    "depth change": (("z",), ("w",)),
    **dict.fromkeys(("acceleration", "speed", "drift"), HORIZONTAL),
    "depth": (("z",),),
    "heading": (("psi",),),
    "pitch": (("theta",),),
    "roll": (("phi",),),
}
"""Alternative groups of channels, one of which must have samples for a family of conditions to be used."""
NICE = np.array([1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
"""Round numbers for the edges of ranges, within a decade."""


@dataclass(frozen=True)
class Pieces:
    """Recording cut into P pieces of a fifth of a second, and into blocks of many pieces.

    Attributes:
        starts: First row of each piece, (P,).
        block: Index of the block that holds each piece, (P,); a block lies within one segment.
        segment: Index of the segment, the rows between two gaps, that holds each piece, (P,).
    """

    starts: Rows
    block: Rows
    segment: Rows

    @classmethod
    def of(cls, record: Recording) -> Pieces:
        """Return a recording cut into pieces of a fifth of a second, and into blocks of many pieces."""
        rows = max(round(PIECE_SECONDS / record.dt), 1)
        length = min(BLOCK_SECONDS, record.rows * record.dt / LEAST_DRAWN)
        within = max(round(length / (rows * record.dt)), 1)
        starts, block, segment = [], [], []
        blocks = 0
        for number, (begin, end) in enumerate(record.segments):
            at = np.arange(begin, end, rows, dtype=np.int64)
            group = consecutive(len(at), within)
            starts.append(at)
            block.append(blocks + group)
            segment.append(np.full(len(at), number, np.int64))
            blocks += int(group[-1]) + 1
        return cls(np.concatenate(starts), np.concatenate(block), np.concatenate(segment))

    def total(self, values: Array) -> Array:
        """Return the sums of values over each of the P pieces, (P, ...).

        Args:
            values: Values in each row of the recording, (N, ...).
        """
        sums: Array = np.add.reduceat(values, self.starts, axis=0)
        return sums


@dataclass(frozen=True)
class Family:
    """Conditions of one kind, of which each of P pieces of time meets at most one.

    Attributes:
        by: Name of the kind, such as `turn` or `speed`.
        words: Words of each condition.
        code: Number of the condition that each piece meets, (P,); -1 for none.
        doing: Whether the words name an activity, such as "turning left", and follow "while"; otherwise they
            add a circumstance, such as "at speeds below 1 m/s".
        unions: Words for several conditions together, and the numbers of these conditions.
        alone: Whether the conditions are never paired with those of other families, as for a family with so
            many conditions that some pair would fit by chance.
    """

    by: str
    words: tuple[str, ...]
    code: Rows
    doing: bool = True
    unions: tuple[tuple[str, tuple[int, ...]], ...] = ()
    alone: bool = False


@dataclass(frozen=True)
class Condition:
    """Condition of a family, or union of conditions.

    Attributes:
        family: The family.
        words: Description in words.
        met: Mask of P pieces of time that meet the condition, (P,).
    """

    family: Family
    words: str
    met: NDArray[np.bool_]


def families(
    record: Recording,
    vehicle: Vehicle,
    pieces: Pieces,
    eta: Array,
    nu: Array,
    nu_dot: Array,
    names: Sequence[str],
) -> list[Family]:
    """Return the families of conditions that distinguish pieces of a recording.

    Args:
        record: Recording of N rows.
        vehicle: Vehicle, with the positions and names of its thrusters.
        pieces: Pieces of the recording.
        eta: Smoothed pose with unwrapped angles, (N, 6) [m, rad].
        nu: Smoothed velocity, body axes, (N, 6) [m/s, rad/s].
        nu_dot: Derivative of the velocity, (N, 6) [m/s^2, rad/s^2].
        names: Name of each segment's session.

    Returns:
        Families that the recording's sensors measure, with at least two conditions that occur.
    """
    rows = pieces.total(np.ones(record.rows))[:, None]
    motion = pieces.total(np.hstack([eta, nu, nu_dot])) / rows
    command = pieces.total(record.commands) / rows
    found = [
        _sessions(pieces, names),
        *_manoeuvres(motion),
        *_surroundings(motion),
        *_commands(command, vehicle),
    ]
    return [
        family
        for family in found
        if record.shows(SHOWN_BY.get(family.by, ((),))) and len(np.unique(family.code[family.code >= 0])) > 1
    ]


def conditions(found: Sequence[Family]) -> Iterator[Condition]:
    """Yield all conditions of families, and all unions of conditions, that some piece of time meets.

    Args:
        found: The families.
    """
    for family in found:
        single = tuple((words, (code,)) for code, words in enumerate(family.words))
        for words, codes in single + family.unions:
            met = np.isin(family.code, codes)
            if met.any():
                yield Condition(family, words, met)


def phrase(several: Sequence[tuple[str, bool]]) -> str:
    """Return several conditions as one phrase, such as "while turning left at speeds below 1 m/s".

    Args:
        several: Pairs of the words of a condition, and whether the words name an activity.
    """
    doing = [words for words, is_doing in several if is_doing]
    being = [words for words, is_doing in several if not is_doing]
    return " ".join(["while " + " and ".join(doing)] * bool(doing) + [" and ".join(being)] * bool(being))


def _sessions(pieces: Pieces, names: Sequence[str]) -> Family:
    """Return the family of conditions "in session NAME"."""
    different = list(dict.fromkeys(names))
    number = np.array([different.index(name) for name in names], np.int64)
    words = tuple(f"in session {name}" for name in different)
    return Family("session", words, number[pieces.segment], doing=False, alone=True)


def _manoeuvres(motion: Array) -> Iterator[Family]:
    """Yield the families turn, depth change, acceleration, speed and drift, from mean motions (P, 18)."""
    nu, nu_dot = motion[:, 6:12], motion[:, 12:]
    R = rotation(*motion[:, 3:6].T)
    sinking = np.einsum("kj,kj->k", R[:, 2], nu[:, :3])
    speed = np.linalg.norm(nu[:, :3], axis=1)
    gain = np.einsum("kj,kj->k", nu[:, :3], nu_dot[:, :3]) / np.maximum(speed, 1e-9)
    yield _signed("turn", nu[:, 5], ("turning left", "going straight", "turning right"), "turning")
    yield _signed("depth change", sinking, ("climbing", "keeping depth", "diving"), "changing depth")
    yield _signed("acceleration", gain, ("braking", "keeping speed", "accelerating"), "changing speed")
    yield _ordered("speed", speed, _edges(speed[speed > HOVERING_SPEED], HOVERING_SPEED), "m/s", "at speeds ")
    yield _drift(nu)


def _drift(nu: Array) -> Family:
    """Return the family of directions of motion in the horizontal body plane, in sectors of 45 degrees."""
    sector = np.round(np.arctan2(nu[:, 1], nu[:, 0]) / (0.25 * np.pi)).astype(np.int64) % 8
    sideways = ("moving right", "moving left")
    return Family(
        "drift",
        (
            "moving ahead",
            "moving ahead and right",
            sideways[0],
            "moving astern and right",
            "moving astern",
            "moving astern and left",
            sideways[1],
            "moving ahead and left",
        ),
        np.where(np.hypot(nu[:, 0], nu[:, 1]) > HOVERING_SPEED, sector, -1),
        unions=(
            ("drifting to the right", (1, 2, 3)),
            ("drifting to the left", (5, 6, 7)),
            ("drifting to either side", (1, 2, 3, 5, 6, 7)),
            ("moving sideways", (2, 6)),
        ),
    )


def _surroundings(motion: Array) -> Iterator[Family]:
    """Yield the families depth, heading, pitch and roll, from mean motions (P, 18)."""
    z, phi, theta, psi = motion[:, 2:6].T
    yield _ordered(
        "depth",
        z,
        _edges(z[z > 0.0]) if np.ptp(z) > 0.5 else [],
        "m",
        "at depths ",
        above=lambda e: f"deeper than {e:g} m",
        below=lambda e: f"shallower than {e:g} m",
    )
    yield Family(
        "heading",
        tuple(f"heading {point}" for point in ("north", "east", "south", "west")),
        np.round(psi / (0.5 * np.pi)).astype(np.int64) % 4,
        unions=(("heading north or south", (0, 2)), ("heading east or west", (1, 3))),
    )
    for by, angle, words in (
        ("pitch", theta, ("with the nose down", "with the nose level", "with the nose up")),
        ("roll", phi, ("rolled to the left", "without roll", "rolled to the right")),
    ):
        code = np.digitize(angle, [-TILTED, TILTED])
        yield Family(by, words, code, doing=False)


def _commands(command: Array, vehicle: Vehicle) -> Iterator[Family]:
    """Yield families for the level of all commands, the commanded wrench and each thruster's command.

    Args:
        command: Mean commands of the pieces, (P, n).
        vehicle: Vehicle, with its thrusters.
    """
    if not command.shape[1]:
        return
    yield _ordered_words(
        "command",
        np.abs(command).max(axis=1),
        [IDLE, 0.35, 0.7],
        ("coasting", "under light thrust", "under medium thrust", "under full thrust"),
    )
    strength = thruster_table(vehicle)[:, MAX_THRUST]
    wrench = command * strength @ configuration_matrix(vehicle).T
    for axis, by, words in (
        (0, "surge command", ("powered astern", "using no surge thrust", "powered ahead")),
        (1, "sway command", ("thrusting left", "using no sideways thrust", "thrusting right")),
        (2, "heave command", ("thrusting up", "using no vertical thrust", "thrusting down")),
        (5, "yaw command", ("thrusting to turn left", "using no turning thrust", "thrusting to turn right")),
    ):
        least = 0.1 * np.abs(wrench[:, axis]).max()
        if least > 0.0:
            yield Family(by, words, np.digitize(wrench[:, axis], [-least, least]))
    for thruster, own in zip(vehicle.thruster, command.T, strict=True):
        name = thruster.name
        yield Family(
            f"thruster {name}",
            (
                f"with {name} below -50 %",
                f"with {name} between -50 and -5 %",
                f"with {name} off",
                f"with {name} between +5 and +50 %",
                f"with {name} above +50 %",
            ),
            np.digitize(own, [-0.5, -IDLE, IDLE, 0.5]),
            doing=False,
            unions=(
                (f"with {name} below -5 %", (0, 1)),
                (f"with {name} above +5 %", (3, 4)),
                (f"with {name} working", (0, 1, 3, 4)),
            ),
            alone=True,
        )


def _signed(by: str, value: Array, words: tuple[str, str, str], both: str) -> Family:
    """Return the family of ranges below, about and above zero of a quantity (P,).

    The ranges are divided at half the root mean square, at least 0.02 and at most 0.1 [SI units].

    Args:
        by: Name of the family.
        value: The quantity, (P,).
        words: Words of the three ranges.
        both: Words for the first and the last range together.
    """
    least = float(np.clip(0.5 * np.sqrt(np.mean(value**2)), 0.02, 0.1))
    return Family(by, words, np.digitize(value, [-least, least]), unions=((both, (0, 2)),))


def _ordered(
    by: str,
    value: Array,
    edges: Sequence[float],
    unit: str,
    of: str,
    above: Callable[[float], str] | None = None,
    below: Callable[[float], str] | None = None,
) -> Family:
    """Return the family of ranges of a quantity (P,), with unions of all ranges above or below each edge.

    Args:
        by: Name of the family.
        value: The quantity, (P,).
        edges: Limits between ranges, ascending.
        unit: Unit in the words.
        of: First words of a range, such as "at speeds ".
        above: Function from an edge to the words for all ranges above; by default "at speeds above 1 m/s".
        below: Function from an edge to the words for all ranges below.
    """
    over = above or (lambda e: f"{of}above {e:g} {unit}")
    under = below or (lambda e: f"{of}below {e:g} {unit}")
    if not edges:
        return Family(by, (), np.full(len(value), -1, np.int64), doing=False)
    between = [f"{of}between {a:g} and {b:g} {unit}" for a, b in itertools.pairwise(edges)]
    last = len(edges)
    unions = [(over(e), tuple(range(i + 1, last + 1))) for i, e in enumerate(edges[:-1])]
    unions += [(under(e), tuple(range(i + 2))) for i, e in enumerate(edges[1:])]
    words = (under(edges[0]), *between, over(edges[-1]))
    return Family(by, words, np.digitize(value, edges), doing=False, unions=tuple(unions))


def _ordered_words(by: str, value: Array, edges: Sequence[float], words: tuple[str, ...]) -> Family:
    """Return the family of ranges of a quantity (P,) between edges, with given words."""
    return Family(by, words, np.digitize(value, edges))


def _edges(value: Array, first: float | None = None) -> list[float]:
    """Return round numbers near the quartiles of positive values, and `first` if given."""
    if not len(value):
        return []
    quartiles = np.maximum(np.quantile(value, [0.25, 0.5, 0.75]), 1e-3)
    decade = 10.0 ** np.floor(np.log10(quartiles))
    near = np.abs(np.log(NICE[:, None] * decade / quartiles)).argmin(axis=0)
    round_ones = {round(float(n * d), 9) for n, d in zip(NICE[near], decade, strict=True)}
    return sorted(round_ones if first is None else round_ones | {first})
