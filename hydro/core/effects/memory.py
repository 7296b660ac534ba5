"""Memory of the fluid: forces that depend on past motion (Cummins 1962; Fossen 2011, section 5.4)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.case import Case
from hydro.core.effects.layout import RELATIVE_VELOCITY
from hydro.core.effects.phrases import Entry, changed, missing
from hydro.core.effects.record import (
    Advice,
    Effect,
    Identification,
    Index,
    Parameter,
    Rest,
    Role,
    Shape,
    Shapes,
    Table,
)
from hydro.core.effects.shapes import along
from hydro.core.effects.units import of_mass, of_moment
from hydro.core.effects.wording import AXES, quantity
from hydro.core.effects.words import CHIRP
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.plausible import ADDED_SOURCE, Plausible, between, most_added

RATES = (0.3, 1.0, 3.0, 8.0)
COARSE_RATES = (0.5, 4.0)
LEAST_RATE, QUICKEST = 1e-3, 25.0  # 1/s, bounds of observable rates


@kernel
def fluid_memory(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench -K (nu_r - a x) with x' = nu_r - a x, for every rate a and axis.

    It equals -int_{-inf}^t K exp(-a (t - t')) nu_r_dot(t') dt': the convolution of Cummins' equation with a
    sum of exponentials, in state-space form.  Steady motion has a x = nu_r and no force, so that damping
    contains the steady part.  For K >= 0 it is passive, with the storage 1/2 a K x^2.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    rates = p.size // 7
    for k in range(rates):
        rate = p[6 * rates + k]
        for i in range(6):
            change = s[RELATIVE_VELOCITY + i] - rate * x[6 * k + i]
            dx[6 * k + i] = change
            tau[i] -= p[6 * k + i] * change


@kernel
def steady_past(p: Array, c: Array, s: Array, x: Array) -> None:
    """Set the internal states `x` to nu_r/a, their value in steady motion at the velocity nu_r.

    a is the decay rate; arguments as in `layout`.
    """
    rates = p.size // 7
    for k in range(rates):
        for i in range(6):
            x[6 * k + i] = s[RELATIVE_VELOCITY + i] / p[6 * rates + k]


def states(p: Array) -> int:
    """Return the number of internal states of fluid memory from its parameters `p`: six per decay rate."""
    return 6 * (p.size // 7)


def at_rates(rates: Sequence[float]) -> Shapes:
    """Return a function that yields trial shapes of `fluid_memory`, one for each given decay rate.

    Each shape, a linear problem at a fixed rate, has one column for the strength on each of the six axes.

    Args:
        rates: Decay rates [1/s].
    """

    def shapes(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
        for rate in rates:
            yield along(FLUID_MEMORY, "K", absent(rate), vehicle)

    return shapes


def absent(rate: float) -> Table:
    """Return a new `[[effect]]` table of `fluid_memory` with one decay rate [1/s] and zero strength."""
    return {"name": FLUID_MEMORY.name, "K": [[0.0] * 6], "rates": [rate]}


def up_to_quickest(index: Index, rest: Rest) -> tuple[float, float]:
    """Return the least and greatest decay rate that a log can show [1/s], LEAST_RATE and QUICKEST.

    Args:
        index: Not used.
        rest: Not used.
    """
    return LEAST_RATE, QUICKEST


def most_strength(index: Index, vehicle: Vehicle) -> tuple[float, float]:
    """Return the least (0) and greatest plausible strength K of the fluid memory on one axis.

    In slow motion K acts as an added mass K/a, with the decay rate a.

    Args:
        index: Index of the component, with the axis (0 to 5) as last entry.
        vehicle: The vehicle, for its greatest plausible added mass.
    """
    return 0.0, float(most_added(vehicle)[index[-1]]) * RATES[-1]


def memory_sentence(case: Case) -> str:
    """Return a sentence that states the strength of the fluid memory on each axis and its decay time."""
    rates = case.many("rates", (rates_of(case),))
    strengths = case.many("K", (len(rates), 6))
    entries = []
    for k, one in enumerate(strengths):
        rate, axis = rates[k // 6].value, AXES[k % 6]
        over = f" over {quantity(1.0 / rate, unit='s')}" if rate > 0.0 else ""
        unit = "N m s" if k % 6 >= 3 else "N s/m"
        entries.append(Entry(f"{axis} fluid memory{over}", f"in {axis}{over}", one, unit))
    if case.in_file:
        decay = [Entry("a rate of decay", "", one, "1/s") for one in rates]
        return changed(case, "the fluid memory", [*entries, *decay])
    return missing(case, "fluid memory", entries)


def rates_of(case: Case) -> int:
    """Return the number of decay rates of the fluid memory, as fitted or else as in the vehicle file."""
    given = case.values.get("rates", (case.before or {}).get("rates", (0.0,)))
    return len(given) if hasattr(given, "__len__") else 1


FLUID_MEMORY = Effect(
    name="fluid_memory",
    family="memory",
    kind="wrench",
    definition="-K (nu_r - a x), x' = nu_r - a x, x(0) = nu_r/a",
    source="Cummins (1962); Fossen (2011), section 5.4",
    excitation="accelerations over times both shorter and longer than 1/a",
    lookalikes=("added_mass", "linear_damping", "thruster_lag"),
    parameters=(
        Parameter(
            "K",
            ("N s/m", "N m s"),
            "strength, six axes per rate",
            ("rates", 6),
            0.0,
            required=True,
            scale=(of_mass(0.3), of_moment(0.5)),
            plausible=Plausible(
                most_strength, "up to the greatest plausible added mass at a rate of 8 1/s", ADDED_SOURCE
            ),
        ),
        Parameter(
            "rates",
            ("1/s",),
            "rates of decay a",
            ("rates",),
            low=LEAST_RATE,
            required=True,
            scale=(1.0,),
            limits=up_to_quickest,
            plausible=between(0.01, QUICKEST, "1/s", "memories of minutes to what a log still shows"),
        ),
    ),
    kernel=fluid_memory,
    sentence=memory_sentence,
    states=states,
    start=steady_past,
    identification=Identification(
        starts=lambda vehicle, reach: [absent(rate) for rate in RATES],
        coarse=at_rates(COARSE_RATES),
        fine=at_rates(RATES),
    ),
    advice=Advice(parted_by=(CHIRP,)),
    roles=frozenset({Role.HULL_WATER}),
)

EFFECTS = (FLUID_MEMORY,)
