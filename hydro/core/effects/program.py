"""Program of a vehicle: one flat vector of numbers, and the functions that compute its effects from it.

The vector contains a header, the constants `c`, one row per wrench effect, all parameters, the thruster
table, and the waves of a sea if one was drawn.  A row has the effect's place in the catalogue and the ranges
of its parameters and states.  As plain numbers, the vector can be in any memory: a numpy array or a numeric
field of a MuJoCo model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import inlined_copy, kernel, separate, within
from hydro.core.effects import layout
from hydro.core.effects.catalogue import (
    CATALOGUE,
    Entry,
    added_mass_matrix,
    current,
    entries,
    inertia_matrix,
    thruster_table,
)
from hydro.core.effects.waves import COMPONENT, drawn, orbits
from hydro.core.errors import DataError
from hydro.core.vehicle import rigid_body
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import COLUMNS

# The header.
EFFECT_COUNT = 0
EFFECT_TABLE = 1  # its start
STATE_COUNT = 2
THRUSTER_COUNT = 3
THRUSTER_TABLE = 4  # its start
SEA = 5  # start of the waves
SEA_SIZE = 6  # size of the waves, 0 for a calm sea
HEADER = 7
EFFECT_ROW = 5  # place in DISPATCHED, first and last parameter, first and last state

DISPATCHED = tuple(effect for effect in CATALOGUE.values() if effect.kernel is not None)
"""Effects with a kernel, in the order used by a program."""


@dataclass(frozen=True)
class Program:
    """Compiled vehicle: all its numbers in one vector, which the compiled functions (kernels) read.

    Attributes:
        flat: All numbers of the vehicle, a contiguous float64 vector, the input of the kernels.
        states: Number of internal states of the effects.
        thrusters: Number of thrusters.
        effects: Names of the wrench effects, in the order of evaluation.
    """

    flat: Array
    states: int
    thrusters: int
    effects: tuple[str, ...]


def assemble(
    vehicle: Vehicle, listed: Sequence[Entry] | None = None, *, sea: Sequence[int] | None = None
) -> Program:
    """Return the compiled vehicle: one vector of numbers that contains its effects and thrusters.

    Args:
        vehicle: The vehicle; effects of kind `sensor` are ignored.
        listed: Result of `entries` for this vehicle, if already computed.
        sea: Seeds of the random waves; by default the sea is calm, as in every prediction.

    Raises:
        DataError: An effect is not valid in the catalogue, or the mass matrix cannot be inverted.
    """
    listed = entries(vehicle) if listed is None else listed
    running = [entry for entry in listed if entry.effect.kernel is not None]
    table, thrusters = np.zeros((len(running), EFFECT_ROW)), thruster_table(vehicle, listed)
    begin = HEADER + layout.CONSTANTS + table.size
    states = 0
    for row, (effect, parameters, _) in zip(table, running, strict=True):
        own = effect.states(parameters) if effect.states is not None else 0
        row[:] = DISPATCHED.index(effect), begin, begin + parameters.size, states, states + own
        begin += parameters.size
        states += own
    header = [len(running), HEADER + layout.CONSTANTS, states, len(thrusters), begin, 0, 0]
    packed = [entry.parameters for entry in running]
    flat = np.concatenate([header, constants(vehicle, listed), table.ravel(), *packed, thrusters.ravel()])
    program = Program(flat, states, len(thrusters), tuple(entry.effect.name for entry in running))
    return program if sea is None else in_sea(program, waves(vehicle, listed, sea))


def in_sea(program: Program, harmonics: Array) -> Program:
    """Return a new program with waves added; the given program is not changed.

    Args:
        program: Program of a vehicle in a calm sea.
        harmonics: Harmonics of the waves, one per row, (H, COMPONENT), as in `core.effects.waves`.
    """
    flat = np.concatenate([program.flat, harmonics.ravel()])
    flat[[SEA, SEA_SIZE]] = program.flat.size, harmonics.size
    return replace(program, flat=flat)


def with_thrusters(program: Program, rows: Array) -> Program:
    """Return a new program with additional thrusters, after those of the given program.

    Args:
        program: Program of a vehicle in a calm sea; it is not changed.
        rows: Constants of the n additional thrusters, (n, COLUMNS), as in `vehicle.thrusters`.
    """
    flat = np.concatenate([program.flat, rows.ravel()])
    flat[THRUSTER_COUNT] += len(rows)
    return replace(program, flat=flat, thrusters=program.thrusters + len(rows))


def seas(vehicle: Vehicle, listed: Sequence[Entry]) -> list[Callable[[Array], Array]]:
    """Return one generator of wave harmonics for each wave effect of a vehicle.

    Args:
        vehicle: The vehicle, for gravity.
        listed: Result of `entries` for this vehicle.

    Returns:
        Functions from the positions of H harmonics within their frequency bands, in [0, 1], (H,), to the
        harmonics, (H, COMPONENT), as `waves.harmonics` returns them.
    """
    gravity = vehicle.environment.gravity
    return [
        partial(effect.harmonics, parameters, gravity)
        for effect, parameters, _ in listed
        if effect.harmonics is not None
    ]


def waves(vehicle: Vehicle, listed: Sequence[Entry], seeds: Sequence[int]) -> Array:
    """Return random harmonics of a sea, one per row, (H, COMPONENT); no rows without wave effects.

    Args:
        vehicle: Vehicle file.
        listed: Result of `entries` for this vehicle.
        seeds: Seeds of the random frequencies and amplitudes.
    """
    rng = np.random.default_rng(seeds)
    return np.concatenate([np.zeros((0, COMPONENT)), *(drawn(sea, rng) for sea in seas(vehicle, listed))])


def constants(vehicle: Vehicle, listed: Sequence[Entry]) -> Array:
    """Return the constants `c` of a vehicle, (CONSTANTS,), in the layout of `core.effects.layout`.

    Args:
        vehicle: The vehicle.
        listed: Result of `entries` for this vehicle.

    Raises:
        DataError: The mass matrix with all effects cannot be inverted.
    """
    c = np.zeros(layout.CONSTANTS)
    body, inertia = vehicle.rigid_body, inertia_matrix(vehicle, listed)
    mass = rigid_body.mass_matrix(vehicle) + inertia
    try:
        inverse = np.linalg.inv(mass)
    except np.linalg.LinAlgError:
        raise DataError("rigid_body: the mass matrix with all effects cannot be inverted") from None
    moved = sum((p for effect, p, _ in listed if effect.name == "buoyancy_offset"), np.zeros(3))
    for at, values in (
        (layout.DENSITY, [vehicle.environment.water_density]),
        (layout.GRAVITY, [vehicle.environment.gravity]),
        (layout.MASS, [body.mass]),
        (layout.BUOYANCY, [vehicle.buoyancy.force]),
        (layout.BALANCE, rigid_body.balance(vehicle)),
        (layout.CENTER_OF_GRAVITY, body.center_of_gravity),
        (layout.CENTER_OF_BUOYANCY, np.asarray(vehicle.buoyancy.center) + moved),
        (layout.HULL, [vehicle.hull.length, vehicle.hull.width, vehicle.hull.height]),
        (layout.HULL_CENTER, vehicle.hull.center),
        (layout.CURRENT, current(vehicle, listed)),
        (layout.ADDED_MASS, added_mass_matrix(vehicle, listed).ravel()),
        (layout.INERTIA, inertia.ravel()),
        (layout.MASS_MATRIX, mass.ravel()),
        (layout.INVERSE_MASS_MATRIX, inverse.ravel()),
    ):
        c[at : at + len(values)] = values
    return c


def changed_effects(flat: Array, other: Array) -> tuple[Array, Array] | None:
    """Return the difference of two vehicles as two programs: added effects, and removed effects.

    Args:
        flat: All numbers of the first vehicle, `Program.flat`.
        other: All numbers of the second vehicle.

    Returns:
        The effects that only the second vehicle has, and those that only the first one has; None if the
        vehicles differ in anything else.  Added effects may have internal states, if these follow the states
        of the first vehicle; removed effects must not have any.
    """
    if not np.array_equal(constants_of(flat), constants_of(other)):
        return None
    if not np.array_equal(thrusters_of(flat), thrusters_of(other)):
        return None
    mine, its = _effects(flat), _effects(other)
    new, gone = _less(its, mine), _less(mine, its)
    states = flat[STATE_COUNT]
    if any(row[3] != row[4] for row, _ in gone) or any(row[3] < states for row, _ in new if row[3] != row[4]):
        return None
    return _program(flat, new, states), _program(flat, gone, states)


def remembering(flat: Array) -> Array:
    """Return a new program that has only those effects of a given program that have internal states.

    Their states evolve as in the whole program.

    Args:
        flat: All numbers of the given program, `Program.flat`.
    """
    return _program(flat, [(row, p) for row, p in _effects(flat) if row[3] != row[4]], 0.0)


def same_memories(flat: Array, other: Array) -> bool:
    """Return whether two programs have the same internal states in the same motion.

    Their thrusters may differ.

    Args:
        flat: All numbers of the first program, `Program.flat`.
        other: All numbers of the second program.
    """
    mine, its = (
        [(row[0], row[3], row[4], p.tobytes()) for row, p in _effects(one) if row[3] != row[4]]
        for one in (flat, other)
    )
    return mine == its and np.array_equal(constants_of(flat), constants_of(other))


def _effects(flat: Array) -> list[tuple[Array, Array]]:
    """Return rows and parameters of a program's effects."""
    begin = int(flat[EFFECT_TABLE])
    rows = flat[begin : begin + EFFECT_ROW * int(flat[EFFECT_COUNT])].reshape(-1, EFFECT_ROW)
    return [(row, flat[int(row[1]) : int(row[2])]) for row in rows]


def _less(some: list[tuple[Array, Array]], others: list[tuple[Array, Array]]) -> list[tuple[Array, Array]]:
    """Return the effects that are not in the others with the same parameters and states."""
    left = [(row[0], row[3], row[4], p.tobytes()) for row, p in others]
    kept = []
    for row, p in some:
        known = (row[0], row[3], row[4], p.tobytes())
        if known in left:
            left.remove(known)
        else:
            kept.append((row, p))
    return kept


def _program(flat: Array, effects: list[tuple[Array, Array]], before: float) -> Array:
    """Return a program of some effects and their states, without thrusters, in another program's water."""
    table, packed = np.zeros((len(effects), EFFECT_ROW)), [p for _, p in effects]
    begin = HEADER + layout.CONSTANTS + table.size
    for row, (source, p) in zip(table, effects, strict=True):
        row[:3] = source[0], begin, begin + p.size
        if source[3] != source[4]:
            row[3:] = source[3:] - before
        begin += p.size
    states = table[:, 4].max(initial=0.0)
    sea = flat[int(flat[SEA]) :][: int(flat[SEA_SIZE])]
    header = [len(effects), HEADER + layout.CONSTANTS, states, 0, begin, begin, sea.size]
    return np.concatenate([header, constants_of(flat), table.ravel(), *packed, sea])


def constants_of(flat: Array) -> Array:
    """Return the constants `c` of a program, a view of shape (CONSTANTS,); see `core.effects.layout`."""
    return flat[HEADER : HEADER + layout.CONSTANTS]


def thrusters_of(flat: Array) -> Array:
    """Return the thruster table of a program, as a view of shape (n, COLUMNS)."""
    begin, count = int(flat[THRUSTER_TABLE]), int(flat[THRUSTER_COUNT])
    return flat[begin : begin + count * COLUMNS].reshape(count, COLUMNS)


@within
def relative_to_water(flat: Array, s: Array) -> None:
    """Compute the velocity through the water, nu_r = nu - [R^T v_c(z, t); 0], and write it to `s`.

    R is the rotation from body to NED, v_c the water's velocity at the depth z and time t.  The velocity nu,
    R, z and t are read from `s`.  With waves, the gradients of the water's velocity are written to `s` too.

    Args:
        flat: All numbers of a program, `Program.flat`.
        s: State of motion in the layout of `core.effects.layout`, changed in place.
    """
    at, growth, trend = (
        HEADER + layout.CURRENT,
        HEADER + layout.CURRENT_GRADIENT,
        HEADER + layout.CURRENT_TREND,
    )
    z, t = s[layout.POSITION + 2], s[layout.TIME]
    north = flat[at] + flat[growth] * z + flat[trend] * t
    east = flat[at + 1] + flat[growth + 1] * z + flat[trend + 1] * t
    down = flat[at + 2]
    swell = int(flat[SEA_SIZE])
    if swell:
        begin = int(flat[SEA])
        to_north, to_east, deeper = orbits(flat[begin : begin + swell], s)
        north, east, down = north + to_north, east + to_east, down + deeper
    for i in range(3):
        water = (
            s[layout.ROTATION + i] * north
            + s[layout.ROTATION + 3 + i] * east
            + s[layout.ROTATION + 6 + i] * down
        )
        s[layout.RELATIVE_VELOCITY + i] = s[layout.VELOCITY + i] - water
        s[layout.RELATIVE_VELOCITY + 3 + i] = s[layout.VELOCITY + 3 + i]


@kernel
def heed(commands: Array, s: Array) -> None:
    """Write the thruster commands of one row of a log to the state of motion `s`.

    Args:
        commands: Commands, (n,); at most MOST_COMMANDS of them are written.
        s: State of motion in the layout of `core.effects.layout`, changed in place.
    """
    for i in range(min(commands.size, layout.MOST_COMMANDS)):
        s[layout.COMMANDS + i] = commands[i]


BEYOND = 10_000
"""Number of lines before generated source: more than this file has."""
_LOOP = """
def {name}({arguments}):
    c = flat[{constants}:{constants_end}]
    row = int(flat[{table}])
    for _ in range(int(flat[{count}])):
        which = int(flat[row])
        p = flat[int(flat[row + 1]):int(flat[row + 2])]
        begin, end = int(flat[row + 3]), int(flat[row + 4])
        {slices}
        row += {length}
"""


def _dispatcher(name: str, arguments: str, functions: Mapping[int, Any], slices: str, call: str) -> Any:
    """Compile a loop over a program's effects that calls a function of each, by its place in `DISPATCHED`.

    Effects without a function are skipped.  The functions are inlined.  Numba cannot cache calls through a
    table of functions on disk, so the source is generated.  It has this file's name, by which Numba finds the
    cache.  Its lines are numbered beyond the end of this file, where `inspect` finds no source; from Python
    3.13 on, it fails at other lines that happen to have the numbers.
    """
    source = _LOOP.format(
        name=name,
        arguments=arguments,
        constants=HEADER,
        constants_end=HEADER + layout.CONSTANTS,
        table=EFFECT_TABLE,
        count=EFFECT_COUNT,
        length=EFFECT_ROW,
        slices=slices,
    )
    for i in functions:
        source += f"        if which == {i}:\n            effect_{i}{call}\n            continue\n"
    namespace: dict[str, Any] = {"__name__": __name__} | {
        f"effect_{i}": inlined_copy(f) for i, f in functions.items()
    }
    exec(compile("\n" * BEYOND + source, __file__, "exec"), namespace)
    return separate(namespace[name])


_ARGUMENTS = "flat, s, x, dx, tau"
_SLICES = "own, its_rates = x[begin:end], dx[begin:end]"  # once, since each costs time to compile
_CALL = "(p, c, s, own, its_rates, tau)"
_KERNELS = {i: effect.kernel for i, effect in enumerate(DISPATCHED)}
_WITH_STATES = {i: effect.kernel for i, effect in enumerate(DISPATCHED) if effect.states is not None}
_STARTS = {i: effect.start for i, effect in enumerate(DISPATCHED) if effect.start is not None}

wrench = _dispatcher("wrench", _ARGUMENTS, _KERNELS, _SLICES, _CALL)
"""`wrench(flat, s, x, dx, tau)`: add the wrench of all effects of a program to tau (6,), write dx
(states,)."""

rates = _dispatcher("rates", _ARGUMENTS, _WITH_STATES, _SLICES, _CALL)
"""`rates(flat, s, x, dx, tau)`: the same for the effects with internal states alone, for their rates dx."""

start = _dispatcher("start", "flat, s, x", _STARTS, "own = x[begin:end]", "(p, c, s, own)")
"""`start(flat, s, x)`: set the internal states (states,) to the steady state of the motion s."""
