"""The record of one physical effect, and how its table in a vehicle file becomes numbers."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.case import Case
from hydro.core.effects.units import Size, dimension, plain_size
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.plausible import Plausible

Kind = Literal["wrench", "inertia", "flow", "actuator", "sensor"]
Kernel = Callable[[Array, Array, Array, Array, Array, Array], None]
Fill = Callable[[Array, Array], None]
Harmonics = Callable[[Array, float, Array], Array]
Index = tuple[int, ...]
Table = dict[str, Any]

BOOKKEEPING = frozenset({"name", "label", "standard_error", "fit", "known"})
"""Keys of an `[[effect]]` table that are no parameters: what a fit leaves beside values, what is known."""


@dataclass(frozen=True)
class Rest:
    """What a vehicle file amounts to without the effects that are fitted: it bounds their increments.

    Attributes:
        vehicle: The vehicle, its thrusters and hull.
        added_mass: M_A in sum, (6, 6).
        linear: Linear damping in sum, (6, 6).
        quadratic: Diagonal of quadratic damping in sum, (6,).
        crossflow: Cross-flow coefficients in sum, (2,).
    """

    vehicle: Vehicle
    added_mass: Array
    linear: Array
    quadratic: Array
    crossflow: Array


Limits = Callable[[Index, Rest], tuple[float, float]]


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, as it stands in a vehicle file.

    Attributes:
        name: Key in the `[[effect]]` table.
        unit: One unit for all entries; or two, for the three forces and the three moments of a 6-vector;
            or three, for the force-velocity, mixed and moment-rate blocks of a 6x6 matrix.
        meaning: What it is, in a few words.
        shape: Lengths; `"thrusters"` and `"rates"` stand for numbers that the vehicle file settles.
        low: Least admissible value (inclusive).
        high: Greatest admissible value (inclusive).
        required: False where leaving it out means 0.
        scale: A plainly visible size for each unit, a number or a rule; None, and all that are left out,
            follow from the unit (`core.effects.units`).
        limits: Bounds of an entry in a fit that depend on the vehicle; by default `low` and `high`.
        symmetric: Whether a matrix has only the entries on and above its diagonal for free.
        plausible: What physics leaves to it: a value beyond is not believed without being told.
        held: Whether a fit leaves it as it is: it says from where another parameter counts.
        power: Whether it is the power of a velocity, on which what it multiplies depends exponentially.
    """

    name: str
    unit: tuple[str, ...]
    meaning: str
    shape: tuple[int | str, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    required: bool = False
    scale: tuple[Size | None, ...] = ()
    limits: Limits | None = None
    symmetric: bool = False
    plausible: Plausible | None = None
    held: bool = False
    power: bool = False

    def __post_init__(self) -> None:
        """Find a unit that is none while the catalogue is made, not while a vehicle is fitted."""
        for unit in self.unit:
            dimension(unit)

    def unit_at(self, index: Index) -> str:
        """Unit of one entry."""
        return self.unit[self._part(index)]

    def scale_at(self, index: Index, vehicle: Vehicle) -> float:
        """A plainly visible size of one entry on this vehicle."""
        part = self._part(index)
        size = self.scale[part] if self.scale else None
        if size is None:
            return plain_size(self.unit[part], vehicle)
        return size(vehicle) if callable(size) else size

    def _part(self, index: Index) -> int:
        """Which of the units an entry has."""
        if len(self.unit) == 3:
            return sum(i >= 3 for i in index)
        return int(index[-1] >= 3) if len(self.unit) == 2 else 0


class Role(Enum):
    """What other parts of the program see in an effect beside its equation."""

    HULL_WATER = "force of the water on the hull, which the teacher's panels and ellipsoid stand in for"
    COMMANDED = "its force may depend on the commands, which jump at a row"
    DRAG = "drag that grows faster than speed: every hull has it, whether its file says so or not"
    COUPLING = "couples axes: drawn back first where a passive hull cannot have what was fitted"
    STEADY_LOAD = "a steady force or moment, which the mean thrust of a hovering vehicle balances"


@dataclass(frozen=True)
class Shape:
    """An effect with the parameters in which it is not linear held at some values, as columns.

    Attributes:
        tables: The `[[effect]]` table with a little of each column.
        steps: That little, in units in which 1 is plain to see.
        begin: Amounts (columns,) to the table that a fit begins from.
    """

    tables: tuple[Table, ...]
    steps: tuple[float, ...]
    begin: Callable[[Array], Table]


Shapes = Callable[[Vehicle, Array | None], Iterator[Shape]]
"""Shapes of an effect on a vehicle, with positions and times (N, 4) of the recording where they are known."""


ABSORBED = 0.3
"""What formulas of drag and lift absorb of a hull of panels: the median of ten bases."""
SLIGHTLY_ABSORBED = 0.1
"""The same of effects of many entries, or slow ones, that no formula of drag or lift is."""


@dataclass(frozen=True)
class Identification:
    """How an effect is looked for in a recording; as it is, one that is linear in all of its parameters.

    Attributes:
        form: Which of `one_of` is tried on a vehicle without the effect; by default the first.
        step: Share of the scale that derivatives are taken over: larger where the effect has kinks.
        resolution: Share of the scale to which it is searched for, where it acts on a row of the log or
            does not; 0 of others.
        starts: Tables to begin from where one beginning is not as good as another.
        coarse: A few shapes that tell whether an effect that is not linear is worth a closer look.
        fine: More of them, which tell where to begin.
        absorbs: Share of the error of data it was not fitted to that it removes of hulls no formula
            describes, where nothing is missing but a formula.
        far: Tables to begin from where the file is so far from the recording that no derivative about the
            effect's absence leads to it.
        plainer: The tables of effects with fewer parameters that it may nearly be on a vehicle, from its own:
            they are tried as well wherever this one would be named.
    """

    form: str | None = None
    step: float = 1e-3
    resolution: float = 0.0
    starts: Callable[[Vehicle, Array | None], list[Table]] | None = None
    coarse: Shapes | None = None
    fine: Shapes | None = None
    absorbs: float = 0.0
    far: tuple[Table, ...] = ()
    plainer: Callable[[Mapping[str, Any], Vehicle], list[Table]] | None = None

    @property
    def linear(self) -> bool:
        """Whether one column per parameter is all there is to it."""
        return self.coarse is None


@dataclass(frozen=True)
class Kinematics:
    """How an error of the velocity log shows in pose against velocity.

    Attributes:
        parameter: The parameter that is estimated.
        place: Its numbers in the row of `core.effects.sensor`.
        negligible: Size that nobody would put right; None is half a sample.
    """

    parameter: str
    place: slice
    negligible: float | None = None


@dataclass(frozen=True)
class Advice:
    """What to say about an effect that was found.

    Attributes:
        parted_by: Motions of `core.effects.parting` that part it from others.
        saying: Fitted parameters and sample time [s] to what else they may mean; None where they mean it.
    """

    parted_by: tuple[str, ...] = ()
    saying: Callable[[Mapping[str, Any], float], str | None] | None = None


@dataclass(frozen=True)
class Words:
    """What a vehicle file writes out of an effect that is no number, a list of texts.

    Attributes:
        name: Key in the `[[effect]]` table, and the name of its length in the shapes of parameters.
        meaning: What it is, in a few words.
        example: For documentation.
        optional: Whether there is an effect without it.
    """

    name: str
    meaning: str
    example: tuple[str, ...]
    optional: bool = False


Structure = Callable[[Mapping[str, Any], str], tuple[Array, dict[str, int]]]
"""Numbers that stand for an effect's words in a table at a place, and the lengths that they give.

Among these is LAST_COMMAND: the number of the last command that is read, 0 of none.
"""
LAST_COMMAND = "last_command"


@dataclass(frozen=True)
class Effect:
    """One effect of the catalogue: everything that any part of the program needs to know of it.

    Exactly the callables of its kind are set.  All take the effect's packed parameter vector first.

    Attributes:
        name: Name in a vehicle file.
        family: The file of `core.effects` it stands in.
        kind: What it acts on: `wrench` adds to tau, `inertia` to M (and brings its Coriolis terms), `flow` to
            the current v_c (and may bring a wrench), `actuator` to the thruster table, `sensor` to the logged
            velocity.
        definition: Its equation on one line, the wrench being the one ON the vehicle.
        source: Where the equation comes from.
        excitation: The motion that a recording must contain for its parameters to be determined.
        lookalikes: Effects that it is easily taken for.
        parameters: In packing order.
        one_of: Names of parameters of which exactly one is given, and the others are not packed.
        kernel: Scalar compiled wrench, see `core.effects.layout`.
        inertia: `inertia(p, M)` adds to a 6x6 matrix.
        flow: `flow(p, flow)` adds to the current, (7,) of `catalogue.current`.
        actuator: `actuator(p, table)` changes the thruster table of `vehicle.thrusters` in place.
        harmonics: `harmonics(p, gravity, places)` gives the rows of `core.effects.waves` that what acts by
            chance is drawn from: in every prediction it is absent, and no fit of predictions finds it.
        sensor: `sensor(p, log)` changes the row `core.effects.sensor` describes, in place.
        states: Number of internal states for a packed parameter vector.
        start: `start(p, c, s, x)` sets them for a motion that has been steady until now.
        identification: How it is looked for.
        kinematics: How kinematics alone shows it; None of all that are no error of the velocity log.
        advice: What is said of it.
        roles: What else it is to other parts of the program.
        repeatable: Whether a vehicle file may have several of it: things, each at a place of its own.
        words: What a file writes out of it beside numbers.
        structure: What these words amount to; packed before the parameters.
        sentence: States its values in words, see `core.effects.sentences`; None for a generic sentence.
    """

    name: str
    family: str
    kind: Kind
    definition: str
    source: str
    excitation: str
    lookalikes: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    one_of: tuple[str, ...] = ()
    kernel: Kernel | None = None
    inertia: Fill | None = None
    flow: Fill | None = None
    actuator: Fill | None = None
    sensor: Fill | None = None
    harmonics: Harmonics | None = None
    states: Callable[[Array], int] | None = None
    start: Callable[[Array, Array, Array, Array], None] | None = None
    identification: Identification = Identification()
    kinematics: Kinematics | None = None
    advice: Advice = Advice()
    roles: frozenset[Role] = frozenset()
    repeatable: bool = False
    words: tuple[Words, ...] = ()
    structure: Structure | None = None
    sentence: Callable[[Case], str] | None = None

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name."""
        return next(parameter for parameter in self.parameters if parameter.name == name)

    @property
    def is_written(self) -> bool:
        """Whether only who writes the file can say what it is: no search can try it."""
        return any(not words.optional for words in self.words)

    @property
    def is_random(self) -> bool:
        """Whether it acts by chance: it predicts nothing, and no fit of predictions can move it."""
        return self.harmonics is not None

    def known(self, table: Mapping[str, Any]) -> frozenset[str]:
        """Names of the parameters that a table holds as known: `known = true`, or a list of some."""
        held = table.get("known", False)
        every = (parameter.name for parameter in self.parameters)
        return frozenset(every if held is True else held or ())

    def written(self, table: Mapping[str, Any]) -> Table:
        """What a table holds in words."""
        return {words.name: table[words.name] for words in self.words if words.name in table}

    def wholly_known(self, table: Mapping[str, Any]) -> bool:
        """Whether a table holds all that it gives as known."""
        given = {one.name for one in self.parameters if one.name not in self.one_of or one.name in table}
        return given <= self.known(table)

    @property
    def description(self) -> str:
        """The docstring of the function that defines it: what a naval engineer would check."""
        for function in (self.kernel, self.inertia, self.flow, self.actuator, self.sensor):
            if function is not None:
                return inspect.getdoc(function) or ""
        raise TypeError(f"effect {self.name} has no defining function")

    def pack(self, table: Mapping[str, Any], *, thrusters: int, where: str = "effect") -> Array:
        """Packed parameter vector of an `[[effect]]` table.

        Args:
            table: The table as read from TOML.
            thrusters: Number of thrusters of the vehicle.
            where: Path of the table, for errors.

        Returns:
            The parameters in order, matrices row by row; a scalar or vector left out is 0.

        Raises:
            DataError: An unknown or missing key, a wrong size, a number out of bounds or not finite, or a
                `known` that names no parameters.
        """
        known = {parameter.name for parameter in self.parameters}
        keys = known | {words.name for words in self.words}
        unknown = sorted(set(table) - keys - BOOKKEEPING)
        if unknown:
            raise DataError(
                f"{where}.{unknown[0]}: {self.name} has no such parameter; it has {', '.join(sorted(keys))}"
            )
        held = table.get("known", False)
        if not (isinstance(held, bool) or (isinstance(held, list | tuple) and known.issuperset(held))):
            raise DataError(
                f"{where}.known: must be true, or a list of parameters of {self.name}: "
                f"{', '.join(sorted(known))}"
            )
        given = [name for name in self.one_of if name in table]
        if self.one_of and len(given) != 1:
            raise DataError(f"{where}: {self.name} needs exactly one of {', '.join(self.one_of)}")
        sizes: dict[str, int] = {"thrusters": thrusters}
        parts = list[Array]()
        if self.structure is not None:
            written, lengths = self.structure(table, where)
            if lengths[LAST_COMMAND] > thrusters:
                last = f"c{lengths[LAST_COMMAND]}"
                raise DataError(f"{where}: {last} is no thruster's command: the vehicle has {thrusters}")
            parts, sizes = [written], sizes | lengths
        parts += [
            _entries(parameter, table, sizes, f"{where}.{parameter.name}")
            for parameter in self.parameters
            if parameter.name not in self.one_of or parameter.name in given
        ]
        return np.concatenate(parts)


def _entries(parameter: Parameter, table: Mapping[str, Any], sizes: dict[str, int], where: str) -> Array:
    """One parameter as a flat vector; a symbolic length not met before is fixed by the first that uses it."""
    if parameter.name not in table:
        if parameter.required:
            raise DataError(f"{where}: is missing ({parameter.meaning})")
        return np.zeros([sizes[n] if isinstance(n, str) else n for n in parameter.shape]).ravel()
    given = table[parameter.name]
    try:
        values = np.asarray(given, dtype=object)
        kinds = set(map(type, values.ravel().tolist()))
        if not all(issubclass(kind, int | float) and kind is not bool for kind in kinds):
            raise ValueError
        values = values.astype(np.float64)
    except ValueError:
        raise DataError(f"{where}: must be {_wanted(parameter, sizes)}") from None
    if parameter.shape and isinstance(parameter.shape[0], str) and values.ndim and len(values):
        sizes.setdefault(parameter.shape[0], len(values))
    if values.shape != tuple(sizes.get(n, -1) if isinstance(n, str) else n for n in parameter.shape):
        raise DataError(f"{where}: must be {_wanted(parameter, sizes)}")
    if not np.isfinite(values).all():
        raise DataError(f"{where}: must be finite")
    if values.size and (values.min() < parameter.low or values.max() > parameter.high):
        raise DataError(f"{where}: must lie within [{parameter.low:g}, {parameter.high:g}]")
    return values.ravel()


def _wanted(parameter: Parameter, sizes: Mapping[str, int]) -> str:
    """What a parameter should look like, for an error message."""
    if not parameter.shape:
        return "a number"
    lengths = [
        str(sizes.get(n, f"one per {n[:-1]}")) if isinstance(n, str) else str(n) for n in parameter.shape
    ]
    return f"an array of {' x '.join(lengths)} numbers"
