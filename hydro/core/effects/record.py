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

CALLED = re.compile(r"\n\n(Adds to|Changes) `\w+`[,;] .*arguments as in `layout`\.$", re.DOTALL)
"""Last paragraph of the docstring of an effect's function, which is for readers of the code alone."""
BOOKKEEPING = frozenset({"name", "label", "standard_error", "fit", "known"})
"""Keys of an `[[effect]]` table that are not parameters: notes of a fit, and known values."""


@dataclass(frozen=True)
class Rest:
    """Inertia and damping of a vehicle without the fitted effects, from which bounds of fitted values follow.

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
    """Parameter of an effect in a vehicle file: a number, a vector or a matrix.

    Attributes:
        name: Key in the `[[effect]]` table.
        unit: One unit for all components; or two units, of the three forces and the three moments of a
            6-vector; or three units, of the force-velocity, mixed and moment-rate blocks of a 6x6 matrix.
        meaning: Meaning in a few words.
        shape: Length of each dimension, () for a number.  `"thrusters"` stands for the number of thrusters of
            the vehicle file, `"rates"` for the number of decay rates in the `[[effect]]` table.
        low: Minimum admissible value (inclusive).
        high: Maximum admissible value (inclusive).
        required: Whether a table must give the parameter; otherwise a missing value means 0.
        scale: Significant size of a component, one for each of `unit`: a number, or a function of the
            vehicle. Where the size is None or missing, it follows from the unit (`core.effects.units`).
        limits: Function that returns the bounds of a component in a fit; None for `low` and `high`.
        symmetric: Whether the parameter is a symmetric matrix, of which a fit varies the entries on and above
            the diagonal only.
        plausible: Physically plausible range; values outside are reported.
        held: Whether a fit never changes the parameter, because it is the reference of another parameter.
        power: Whether the parameter is the exponent of a velocity.  The best coefficient of that velocity
            then depends exponentially on the parameter.
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
        """Return the unit of one component of the parameter.

        Args:
            index: Index of the component in the parameter's array; () for a number.
        """
        return self.unit[self._part(index)]

    def scale_at(self, index: Index, vehicle: Vehicle) -> float:
        """Return the significant size of one component, in the component's unit.

        Args:
            index: Index of the component in the parameter's array; () for a number.
            vehicle: Vehicle, from which most sizes follow.
        """
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
    """Property of an effect that other parts of the program need besides its equation."""

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
        tables: For each column, the `[[effect]]` table in which its parameter has a small value.
        steps: These small values, as multiples of the parameter's significant size.
        begin: Function from the fitted coefficients of the columns, (columns,), to the table from which a
            nonlinear fit starts.
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
    """Settings of the search for an effect in a recording.

    The defaults suit an effect that is linear in all of its parameters.

    Attributes:
        form: Parameter, one of the effect's `one_of`, that is tried on a vehicle without the effect; None for
            the first one.
        step: Step of numerical derivatives, relative to the significant size of a parameter; larger for an
            effect with kinks.
        resolution: Smallest useful step of the search, relative to the significant size, for an effect that
            acts in whole rows of the log, such as a delay; else 0.
        starts: Function that returns initial tables of a fit with several local minima.  Its arguments are
            those of `Shapes`.
        coarse: A few trial shapes that show whether a nonlinear effect deserves a closer search; None for a
            linear effect.
        fine: More trial shapes, which supply initial values of the nonlinear fit.
        absorbs: Share of the held-out error of hulls that no formula describes, which the effect removes
            although nothing else is missing.
        far: Further initial tables, for a vehicle file so wrong that derivatives at zero do not lead to the
            effect.
        plainer: Function that returns tables of simpler effects with nearly the same force on a vehicle.
            They are tried wherever this effect would be named.
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
        """Whether the effect is linear in all parameters: a regression then has one column for each."""
        return self.coarse is None


@dataclass(frozen=True)
class Kinematics:
    """How a DVL error shows in the difference between logged velocity and the rate of the logged pose.

    Attributes:
        parameter: Name of the estimated parameter.
        place: Indices of the parameter in the vector of DVL errors of `core.effects.sensor`.
        negligible: Size below which no correction is needed; None for half a sample time.
    """

    parameter: str
    place: slice
    negligible: float | None = None


@dataclass(frozen=True)
class Advice:
    """Advice to the user about an effect that a diagnosis found.

    Attributes:
        parted_by: Motions of `core.effects.parting` that separate the effect from similar ones.
        saying: Function from fitted parameters and sample time [s] to another possible cause of the finding,
            in words, or None.
    """

    parted_by: tuple[str, ...] = ()
    saying: Callable[[Mapping[str, Any], float], str | None] | None = None


@dataclass(frozen=True)
class Words:
    """Part of an effect that a vehicle file gives as a list of texts, such as the terms of a formula.

    Attributes:
        name: Key in the `[[effect]]` table.  In the `shape` of a parameter it stands for the number of texts.
        meaning: Meaning in a few words.
        example: Texts for the documentation.
        optional: Whether the list may be missing.
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
    """Effect of the catalogue, with all data on it that any part of the program needs.

    One of the functions `kernel`, `inertia`, `flow`, `actuator` and `sensor` is the effect's equation; `kind`
    says which.  (A `flow` effect may also have a `kernel`.)  Their arguments, and the packed parameters `p`,
    are in `core.effects.layout`.

    Attributes:
        name: Name in a vehicle file.
        family: Name of the module of `core.effects` that defines the effect.
        kind: What the effect changes: `wrench` the wrench tau on the vehicle, `inertia` the mass matrix M and
            its Coriolis terms, `flow` the current v_c, `actuator` the thruster table, `sensor` the logged
            velocity.
        definition: Equation on one line; a wrench is the one ON the vehicle.
        source: Where the equation comes from.
        excitation: Motion that a recording must contain to determine the parameters.
        lookalikes: Names of effects that are easily mistaken for this one.
        parameters: Parameters, in the order in which `pack` writes them.
        one_of: Names of alternative parameters, such as `diagonal` and `matrix`.  A table gives exactly one
            of them, and `pack` writes only that one.
        kernel: `kernel(p, c, s, x, dx, tau)` adds the wrench to tau.
        inertia: `inertia(p, M)` adds to the 6x6 mass matrix M.
        flow: `flow(p, flow)` adds to the motion of the water, (7,), see `catalogue.current`.
        actuator: `actuator(p, table)` changes the thruster table of `vehicle.thrusters` in place.
        sensor: `sensor(p, log)` changes the vector of DVL errors of `core.effects.sensor` in place.
        harmonics: `harmonics(p, gravity, places)` returns the harmonics from which a random effect, such as
            waves, is drawn (`core.effects.waves`).  A random effect is absent in every prediction, so no fit
            of predictions finds it.
        states: Function from packed parameters to the number of internal states; None without states.
        start: `start(p, c, s, x)` sets the internal states x to their values in steady motion.
        identification: How a search looks for the effect in a recording.
        kinematics: How a DVL error shows in pose and velocity; None for any other effect.
        advice: Advice to the user after the effect was found.
        roles: Properties that other parts of the program need.
        repeatable: Whether a vehicle file may have several such effects, as objects at different places.
        words: Lists of texts in the effect's table, such as the terms of a formula.
        structure: Function that converts these texts to numbers, which `pack` writes before the parameters.
        sentence: Function that states fitted values in words, see `core.effects.sentences`; None for a
            general sentence.
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
        """Return the parameter with a given name."""
        return next(parameter for parameter in self.parameters if parameter.name == name)

    @property
    def is_written(self) -> bool:
        """Whether a vehicle file must give a part of the effect as text; no search can try such an effect."""
        return any(not words.optional for words in self.words)

    @property
    def is_random(self) -> bool:
        """Whether the effect is random: it predicts nothing, and no fit of predictions can change it."""
        return self.harmonics is not None

    def known(self, table: Mapping[str, Any]) -> frozenset[str]:
        """Return the names of the parameters that an `[[effect]]` table marks as known: no fit changes them.

        Args:
            table: The table, with `known = true` for all parameters, or a list of names.
        """
        held = table.get("known", False)
        every = (parameter.name for parameter in self.parameters)
        return frozenset(every if held is True else held or ())

    def written(self, table: Mapping[str, Any]) -> Table:
        """Return those entries of an `[[effect]]` table that are lists of texts, such as formula terms."""
        return {words.name: table[words.name] for words in self.words if words.name in table}

    def wholly_known(self, table: Mapping[str, Any]) -> bool:
        """Return whether an `[[effect]]` table marks all of its parameters as known."""
        given = {one.name for one in self.parameters if one.name not in self.one_of or one.name in table}
        return given <= self.known(table)

    @property
    def description(self) -> str:
        """Docstring of the function with the effect's equation, without the paragraph on its arguments."""
        for function in (self.kernel, self.inertia, self.flow, self.actuator, self.sensor):
            if function is not None:
                return CALLED.sub("", inspect.getdoc(function) or "")
        raise TypeError(f"effect {self.name} has no defining function")

    def pack(self, table: Mapping[str, Any], *, thrusters: int, where: str = "effect") -> Array:
        """Return the parameters of an `[[effect]]` table as one vector of numbers.

        Args:
            table: The table as read from TOML.
            thrusters: Number of thrusters of the vehicle.
            where: Path of the table, for errors.

        Returns:
            The parameters in the order of the record, matrices row by row; a missing scalar or vector is 0.

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
