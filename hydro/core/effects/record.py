"""Record of a physical effect, and conversion of its table in a vehicle file to numbers."""

from __future__ import annotations

import inspect
import math
import re
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

CALLED = re.compile(r"\n\n(Adds to|Changes) `\w+`; arguments as in `layout`\.$")
"""Last line of the docstring of an effect's function, which is for readers of the code alone."""
BOOKKEEPING = frozenset({"name", "label", "standard_error", "fit", "known"})
"""Keys of an `[[effect]]` table that are not parameters: notes of a fit, and known values."""


@dataclass(frozen=True)
class Rest:
    """Sums over the effects of a vehicle file that are not fitted, which bound the fitted increments.

    Attributes:
        vehicle: The vehicle, its thrusters and hull.
        added_mass: Total M_A, (6, 6).
        linear: Total linear damping, (6, 6).
        quadratic: Diagonal of total quadratic damping, (6,).
        crossflow: Total cross-flow coefficients, (2,).
    """

    vehicle: Vehicle
    added_mass: Array
    linear: Array
    quadratic: Array
    crossflow: Array


Limits = Callable[[Index, Rest], tuple[float, float]]


@dataclass(frozen=True)
class Parameter:
    """Parameter of an effect in a vehicle file.

    Attributes:
        name: Key in the `[[effect]]` table.
        unit: One unit for all components; or two, for the three forces and the three moments of a 6-vector;
            or three, for the force-velocity, mixed and moment-rate blocks of a 6x6 matrix.
        meaning: Meaning in a few words.
        shape: Lengths; `"thrusters"` and `"rates"` are numbers set by the vehicle file.
        low: Minimum admissible value (inclusive).
        high: Maximum admissible value (inclusive).
        required: False if a missing value means 0.
        scale: Significant size for each unit, a number or a rule; None and missing ones follow from the unit
            (`core.effects.units`).
        limits: Bounds of a component in a fit that depend on the vehicle; by default `low` and `high`.
        symmetric: Whether only the entries on and above the diagonal of a matrix are free.
        plausible: Physically plausible range; a value beyond is reported.
        held: Whether a fit keeps it fixed: it is the reference of another parameter.
        power: Whether it is the exponent of a velocity, on which its coefficient depends exponentially.
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
        """Check the units when the catalogue is built, not when a vehicle is fitted."""
        for unit in self.unit:
            dimension(unit)

    def unit_at(self, index: Index) -> str:
        """Return the unit of one component."""
        return self.unit[self._part(index)]

    def scale_at(self, index: Index, vehicle: Vehicle) -> float:
        """Return the significant size of one component on this vehicle."""
        part = self._part(index)
        size = self.scale[part] if self.scale else None
        if size is None:
            return plain_size(self.unit[part], vehicle)
        return size(vehicle) if callable(size) else size

    def _part(self, index: Index) -> int:
        """Return the index of the unit of a component."""
        if len(self.unit) == 3:
            return sum(i >= 3 for i in index)
        return int(index[-1] >= 3) if len(self.unit) == 2 else 0


class Role(Enum):
    """Role of an effect for other parts of the program, in addition to its equation."""

    HULL_WATER = "force of the water on the hull, which the simulator's panels and ellipsoid replace"
    COMMANDED = "its force may depend on the commands, which jump at a row"
    DRAG = "drag that grows faster than speed: every hull has it, even if its file does not"
    WHOLE_HULL = "the drag of the whole hull: it completes a file, and is no change of one that has drag"
    COUPLING = "coupling of axes: reduced first if the fitted values are impossible for a passive hull"
    STEADY_LOAD = "a steady force or moment, which the mean thrust of a hovering vehicle balances"


@dataclass(frozen=True)
class Shape:
    """Linear problem of an effect whose nonlinear parameters are held at trial values.

    A search tries an effect at several shapes, for example a dead band at several widths.  At one shape the
    force is linear in the remaining parameters.  Each of them is one column of a regression.

    Attributes:
        tables: For each column, the `[[effect]]` table with a small amount of this parameter.
        steps: These amounts, in units in which 1 is a significant size.
        begin: Function from fitted amounts (columns,) to the initial table of a nonlinear fit.
    """

    tables: tuple[Table, ...]
    steps: tuple[float, ...]
    begin: Callable[[Array], Table]


Shapes = Callable[[Vehicle, Array | None], Iterator[Shape]]
"""Function that yields the shapes of an effect.  Its arguments are a vehicle, and the positions [m] and times
[s] of the recording, (N, 4), or None without them."""


ABSORBED = 0.3
"""Share of the error of a hull of panels that formulas of drag and lift absorb: the median of ten bases."""
SLIGHTLY_ABSORBED = 0.1
"""Absorbed share of effects with many components, or slow ones, that are not formulas of drag or lift."""


@dataclass(frozen=True)
class Identification:
    """Search for an effect in a recording; by default, of an effect that is linear in all of its parameters.

    Attributes:
        form: The alternative of `one_of` tried on a vehicle without the effect; by default the first.
        step: Step of derivatives relative to the scale: larger if the effect has kinks.
        resolution: Resolution of the search relative to the scale, for an effect that acts on a row of the
            log or does not; else 0.
        starts: Initial tables of a fit that may have several local minima.
        coarse: A few shapes that show whether a nonlinear effect deserves a closer look.
        fine: More shapes, which supply initial values.
        absorbs: Share of the held-out error that it removes for hulls that no formula describes, if nothing
            else is missing.
        far: Initial tables for a file so far from the recording that derivatives at zero do not lead to the
            effect.
        plainer: Function to tables of effects with fewer parameters that approximate it on a vehicle; these
            are tried wherever this effect would be named.
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
        """Whether one column per parameter suffices."""
        return self.coarse is None


@dataclass(frozen=True)
class Kinematics:
    """Kinematic signature of a DVL error in pose against velocity.

    Attributes:
        parameter: The parameter that is estimated.
        place: Its indices in the row of `core.effects.sensor`.
        negligible: Size that needs no correction; None is half a sample.
    """

    parameter: str
    place: slice
    negligible: float | None = None


@dataclass(frozen=True)
class Advice:
    """Advice on an effect that was found.

    Attributes:
        parted_by: Motions of `core.effects.parting` that separate it from others.
        saying: Function from fitted parameters and sample time [s] to an alternative meaning; None if there
            is none.
    """

    parted_by: tuple[str, ...] = ()
    saying: Callable[[Mapping[str, Any], float], str | None] | None = None


@dataclass(frozen=True)
class Words:
    """Textual part of an effect in a vehicle file, a list of texts.

    Attributes:
        name: Key in the `[[effect]]` table, and the name of its length in the shapes of parameters.
        meaning: Meaning in a few words.
        example: For documentation.
        optional: Whether the effect exists without it.
    """

    name: str
    meaning: str
    example: tuple[str, ...]
    optional: bool = False


Structure = Callable[[Mapping[str, Any], str], tuple[Array, dict[str, int]]]
"""Function from a table and its place to the numbers that represent an effect's words, and to their lengths.
The lengths include LAST_COMMAND: the number of the last command in use, 0 for none."""
LAST_COMMAND = "last_command"


@dataclass(frozen=True)
class Effect:
    """Effect of the catalogue: all data on it that any part of the program needs.

    Exactly the callables of its kind are set.  The first argument of each is the effect's packed parameter
    vector.

    Attributes:
        name: Name in a vehicle file.
        family: Its file in `core.effects`.
        kind: Target of the effect: `wrench` adds to tau, `inertia` to M (with its Coriolis terms), `flow` to
            the current v_c (and possibly a wrench), `actuator` to the thruster table, `sensor` to the logged
            velocity.
        definition: Its equation on one line, the wrench being the one ON the vehicle.
        source: Where the equation comes from.
        excitation: The motion that a recording must contain for its parameters to be determined.
        lookalikes: Effects that it is easily mistaken for.
        parameters: In packing order.
        one_of: Names of alternative parameters, of which exactly one is given; the others are not packed.
        kernel: Scalar compiled wrench. `core.effects.layout` has the arguments of this function and of all
            others.
        inertia: `inertia(p, M)` adds to a 6x6 matrix.
        flow: `flow(p, flow)` adds to the current, (7,) of `catalogue.current`.
        actuator: `actuator(p, table)` changes the thruster table of `vehicle.thrusters` in place.
        harmonics: `harmonics(p, gravity, places)` returns the rows of `core.effects.waves` from which a
            random effect is drawn: it is absent in every prediction, and no fit of predictions finds it.
        sensor: `sensor(p, log)` changes the row of `core.effects.sensor`, in place.
        states: Number of internal states for a packed parameter vector.
        start: `start(p, c, s, x)` sets them to the steady state of a motion.
        identification: Search for the effect.
        kinematics: Kinematic signature; None if it is not a DVL error.
        advice: Advice on it.
        roles: Its roles for other parts of the program.
        repeatable: Whether a vehicle file may have several of it: objects, each at its own place.
        words: Its textual parts in a file.
        structure: Conversion of these words to numbers, packed before the parameters.
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
        """Return the parameter of that name."""
        return next(parameter for parameter in self.parameters if parameter.name == name)

    @property
    def is_written(self) -> bool:
        """Whether its form is written in the file, so that no search can try it."""
        return any(not words.optional for words in self.words)

    @property
    def is_random(self) -> bool:
        """Whether it is random: it predicts nothing, and no fit of predictions can change it."""
        return self.harmonics is not None

    def known(self, table: Mapping[str, Any]) -> frozenset[str]:
        """Return the names of the parameters that a table holds as known: `known = true`, or a list."""
        held = table.get("known", False)
        every = (parameter.name for parameter in self.parameters)
        return frozenset(every if held is True else held or ())

    def written(self, table: Mapping[str, Any]) -> Table:
        """Return the textual part of a table."""
        return {words.name: table[words.name] for words in self.words if words.name in table}

    def wholly_known(self, table: Mapping[str, Any]) -> bool:
        """Return whether a table holds all of its parameters as known."""
        given = {one.name for one in self.parameters if one.name not in self.one_of or one.name in table}
        return given <= self.known(table)

    @property
    def description(self) -> str:
        """Docstring of its defining function, without its last line on the calling convention."""
        for function in (self.kernel, self.inertia, self.flow, self.actuator, self.sensor):
            if function is not None:
                return CALLED.sub("", inspect.getdoc(function) or "")
        raise TypeError(f"effect {self.name} has no defining function")

    def pack(self, table: Mapping[str, Any], *, thrusters: int, where: str = "effect") -> Array:
        """Pack the parameters of an `[[effect]]` table to a vector.

        Args:
            table: The table as read from TOML.
            thrusters: Number of thrusters of the vehicle.
            where: Path of the table, for errors.

        Returns:
            The parameters in order, matrices row by row; a missing scalar or vector is 0.

        Raises:
            DataError: A key is unknown or missing, a size is wrong, a number is out of bounds or not finite,
                or `known` names no parameter.
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
    """Return one parameter as a flat vector; its first use sets a symbolic length."""
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
    """Describe the expected form of a parameter, for an error message."""
    if not parameter.shape:
        return "a number"
    lengths = [
        str(sizes.get(n, f"one per {n[:-1]}")) if isinstance(n, str) else str(n) for n in parameter.shape
    ]
    return f"an array of {' x '.join(lengths)} numbers"
