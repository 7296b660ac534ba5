"""Custom wrench: terms written in a vehicle file, evaluated by one kernel (no code is executed).

A term is an axis of the wrench and a product, as in `Y |v|^1.4 v` or `N |u| r`.  The factors are as follows.
The velocity through the water is `u v w p q r` [m/s, rad/s].  The direction of gravity in body axes is `g_x
g_y g_z` (-sin theta, cos theta sin phi, cos theta cos phi).  The depth of CO is `z` [m].  The commands of the
thrusters are `c1 c2 ...`, in the order of the file, as given, before any delay.

A factor is such a name `v`, with a whole exponent `v^2`, its size `|v|` with any exponent `|v|^0.5`, or its
sign `sgn(v)`.  The exponent of `|v|^n` is a number of the file that a fit may change, the next of
`exponents`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hydro.core.columns import VELOCITY, WRENCH, Array
from hydro.core.compiled import kernel
from hydro.core.effects.case import Case, Quantity
from hydro.core.effects.layout import COMMAND_NAMES, COMMANDS, POSITION, RELATIVE_VELOCITY, ROTATION
from hydro.core.effects.phrases import Entry, changed, missing
from hydro.core.effects.record import LAST_COMMAND, Advice, Effect, Identification, Parameter, Role, Words
from hydro.core.effects.units import of_mass, of_moment
from hydro.core.effects.wording import AXES as NAMES_OF_AXES
from hydro.core.effects.words import COASTING
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.plausible import Index, Plausible, between, most_drag

NAMES = (*VELOCITY, "g_x", "g_y", "g_z", "z", *COMMAND_NAMES)
PLACES = (
    *range(RELATIVE_VELOCITY, RELATIVE_VELOCITY + 6),
    *range(ROTATION + 6, ROTATION + 9),
    POSITION + 2,
    *range(COMMANDS, COMMANDS + len(COMMAND_NAMES)),
)
"""Index of each factor in the state of motion."""
AXES = WRENCH
GROUPS = (("forces", "force"), ("moments", "moment"))
"""Keys of the terms and of their coefficients."""
FACTORS = 3
"""Maximum number of factors in a term."""
ROW = 1 + 3 * FACTORS
"""Numbers per term: its axis, and for each factor its index in the state, exponent and sign flag."""
NOWHERE = -1.0
"""Index of a missing factor."""
LEAST_POWER, MOST_POWER = 0.0, 4.0
FACTOR = re.compile(r"(?:\|(?P<size>\w+)\||sgn\((?P<sign>\w+)\)|(?P<plain>[A-Za-z]\w*))(?:\^(?P<power>\S+))?")
GRAMMAR = (
    "an axis X Y Z K M N and at most three factors such as `Y |v|^1.5 v`, of "
    + " ".join(NAMES[: -len(COMMAND_NAMES) + 1])
    + f" ... {NAMES[-1]}"
)


@kernel
def formula(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench c_k prod |x|^a sgn(x)^s for every term k, on its axis.

    c_k is the coefficient, the product is over the factors x of the term, a and s are their exponents.  The
    coefficient is the force or moment with every factor equal to 1: at 1 m/s or 1 rad/s, 1 m deep.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    terms = int(p[0])
    amounts = 1 + ROW * terms
    exponents = amounts + terms
    for k in range(terms):
        value = p[amounts + k]
        row = 1 + ROW * k
        for f in range(FACTORS):
            place = int(p[row + 1 + 3 * f])
            if place < 0:
                break
            here = s[place]
            power = p[row + 2 + 3 * f]
            if power < 0.0:  # one of the file's exponents, counted from -1 down
                power = p[exponents - int(power) - 1]
            size = abs(here)
            if power == 1.0:
                value *= size
            elif power == 2.0:
                value *= size * size
            elif size == 0.0:
                value *= 0.0 if power > 0.0 else 1.0
            elif power != 0.0:
                value *= math.exp(power * math.log(size))
            if p[row + 3 + 3 * f] != 0.0:
                value *= 1.0 if here > 0.0 else -1.0 if here < 0.0 else 0.0
        tau[int(p[row])] += value


def parsed(term: Any, where: str = "formula") -> tuple[Array, int]:
    """Return one term of a formula as numbers for the kernel, and the number of its free exponents.

    Args:
        term: Term as in a vehicle file, such as `Y |v|^1.4 v`.
        where: Path in the vehicle file, for the error.

    Returns:
        Row of the kernel, (ROW,), with -1, -2, ... in place of exponents that a fit may change; and the
        number of these exponents.

    Raises:
        DataError: The term is invalid.
    """
    row, exponents = np.full(ROW, NOWHERE), 0
    words = term.split() if isinstance(term, str) else []
    if not words or words[0] not in AXES or len(words) > 1 + FACTORS:
        raise DataError(f"{where}: {term!r} is no term: write {GRAMMAR}")
    row[0] = AXES.index(words[0])
    for number, word in enumerate(words[1:]):
        found = FACTOR.fullmatch(word)
        name = found and (found["size"] or found["sign"] or found["plain"])
        if found is None or name not in NAMES or (found["sign"] and found["power"]):
            raise DataError(f"{where}: {word!r} in {term!r} is no factor: write {GRAMMAR}")
        power, sign = _power(found, where, term)
        if power is None:
            exponents += 1
        at = 1 + 3 * number
        row[at : at + 3] = PLACES[NAMES.index(name)], -exponents if power is None else power, sign
    return row, exponents


def _power(found: re.Match[str], where: str, term: str) -> tuple[float | None, float]:
    """Return the exponents of the size and of the sign; the first is None for one of the file's exponents."""
    if found["sign"]:
        return 0.0, 1.0
    text = found["power"] or "1"
    if found["size"] and text == "n":
        return None, 0.0
    whole = text.isdecimal()
    try:
        power = float(text)
    except ValueError:
        power = math.nan
    if not LEAST_POWER <= power <= MOST_POWER or not (whole or found["size"]):
        kind = "a number or n" if found["size"] else "a whole number; `|v|^1.5 v` has another"
        raise DataError(
            f"{where}: the power of {found[0]!r} in {term!r} must be {kind}, up to {MOST_POWER:g}"
        )
    return power, 0.0 if found["size"] else float(int(power) % 2)


def structure(table: Mapping[str, Any], where: str = "effect") -> tuple[Array, dict[str, int]]:
    """Return all terms of a formula in the form that the kernel reads, and the lengths of its parameters.

    Args:
        table: `[[effect]]` table of the formula.
        where: Path of the table, for errors.

    Returns:
        Number of terms, followed by the row of each term; and the numbers of forces, moments and exponents,
        with `last_command`, the number of the last thruster command in use (0 for none).

    Raises:
        DataError: A term is invalid, or a force is listed with the moments.
    """
    rows, exponents, commands = [], 0, 0
    for key, axes in (("forces", AXES[:3]), ("moments", AXES[3:])):
        terms = table.get(key, [])
        if not isinstance(terms, list | tuple):
            raise DataError(f"{where}.{key}: must be a list of terms, each {GRAMMAR}")
        for index, term in enumerate(terms):
            row, count = parsed(term, f"{where}.{key}[{index}]")
            if AXES[int(row[0])] not in axes:
                raise DataError(f"{where}.{key}[{index}]: {term!r} belongs to {_other(key)}")
            row[2::3] = np.where(row[2::3] < 0.0, row[2::3] - exponents, row[2::3])
            row[2::3][row[1::3] == NOWHERE] = 0.0
            exponents += count
            commands = max(commands, int(row[1::3].max()) - COMMANDS + 1)
            rows.append(row)
    if not rows:
        raise DataError(f"{where}: formula needs terms in `forces` or `moments`, each {GRAMMAR}")
    if exponents and "exponents" not in table:
        raise DataError(
            f"{where}.exponents: is missing: a number for each of the {exponents} powers written ^n"
        )
    sizes = {key: len(table.get(key, [])) for key in ("forces", "moments")}
    sizes |= {"exponents": exponents, LAST_COMMAND: commands}
    return np.concatenate([[len(rows)], *rows]), sizes


def _other(key: str) -> str:
    return "moments" if key == "forces" else "forces"


def one_term(term: str, amount: float, exponents: Sequence[float] = ()) -> dict[str, Any]:
    """Return a new `[[effect]]` table of a formula that has a single term.

    Args:
        term: Term as in a vehicle file, such as `Y |v|^1.4 v`.
        amount: Coefficient, the force [N] or moment [N m] with every factor equal to 1.
        exponents: Values of those exponents of the term that a fit may change.
    """
    key, value = ("force", "forces") if term[0] in AXES[:3] else ("moment", "moments")
    return {"name": FORMULA.name, value: [term], key: [amount], "exponents": list(exponents)}


def amounts(table: Mapping[str, Any]) -> list[tuple[str, float, tuple[float, ...]]]:
    """Return the terms of a formula with their numbers, forces before moments.

    Args:
        table: `[[effect]]` table of the formula.

    Returns:
        For each term its text, its coefficient (0 if missing) and its exponents that a fit may change.
    """
    powers, found = iter(table.get("exponents", ())), []
    for group, values in GROUPS:
        terms = table.get(group, ())
        for text, value in zip(terms, table.get(values) or [0.0] * len(terms), strict=True):
            free = tuple(float(next(powers)) for _ in range(parsed(text)[1]))
            found.append((str(text), float(value), free))
    return found


def joined(tables: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return one new `[[effect]]` table with the terms of several formulas, all forces before all moments.

    Each term keeps its coefficient and exponents.

    Args:
        tables: `[[effect]]` tables of the formulas.
    """
    every = [term for table in tables for term in amounts(table)]
    forces, moments = ([one for one in every if (one[0][0] in AXES[:3]) is force] for force in (True, False))
    whole: dict[str, Any] = {"name": FORMULA.name}
    for (terms, values), group in zip(GROUPS, (forces, moments), strict=True):
        whole |= {terms: [text for text, _, _ in group], values: [value for _, value, _ in group]}
    return whole | {"exponents": [power for _, _, powers in (*forces, *moments) for power in powers]}


def as_drag(force: bool) -> Plausible:
    """Return the plausible range of a formula's coefficient: the hull's drag, or the weight if larger.

    The drag is that of the hull's box at 1 m/s or 1 rad/s; either sign is allowed.

    Args:
        force: Whether the coefficient is of a force [N], otherwise of a moment [N m].
    """

    def at(index: Index, vehicle: Vehicle) -> tuple[float, float]:
        weight = vehicle.rigid_body.mass * vehicle.environment.gravity
        arm = 1.0 if force else vehicle.hull.length
        drag = most_drag(vehicle)[:3] if force else most_drag(vehicle)[3:]
        most = max(float(drag.max()), weight * arm)
        return -most, most

    words = "either way up to the drag of the hull's box at 1 m/s or 1 rad/s, or to the weight"
    return Plausible(at, words, "dimensional analysis")


def formula_sentence(case: Case) -> str:
    """Return a sentence that states the coefficient of each term, as the vehicle file writes the term."""
    whole = {**(case.before or {}), **case.values}
    powers = iter(case.many("exponents", (sum(parsed(text)[1] for text in every_term(whole)),)))
    entries = []
    for group, values in GROUPS:
        terms = [str(term) for term in whole.get(group, ())]
        same = list((case.before or {}).get(group, ())) == terms
        for text, given in zip(terms, case.many(values, (len(terms),)), strict=True):
            one = given if same else Quantity(given.value, given.error)
            axis, _, product = text.partition(" ")
            free = [next(powers) for _ in range(parsed(text)[1])]
            for power in free:
                product = product.replace("^n", f"^{power.text().partition(' (±')[0]}", 1)
            name = NAMES_OF_AXES[AXES.index(axis)]
            unit = "N" if group == GROUPS[0][0] else "N m"
            shown = product or "constant"
            entries.append(Entry(f"{name} coefficient of {shown}", f"times {shown} in {name}", one, unit))
            if case.in_file:
                entries += [Entry(f"power in {name}", "", power, "1") for power in free]
    if case.in_file:
        return changed(case, "the formula", entries)
    nouns = [noun for noun, (group, _) in zip(("force", "moment"), GROUPS, strict=True) if whole.get(group)]
    return missing(case, f"a {' and '.join(nouns)}", entries)


def every_term(table: Mapping[str, Any]) -> list[str]:
    """Return the texts of a formula's terms, forces first."""
    return [str(term) for group, _ in GROUPS for term in table.get(group, ())]


FORMULA = Effect(
    name="formula",
    family="formula",
    kind="wrench",
    definition="c_k prod abs(x)^a sgn(x)^s on the axis of each term k",
    source="the vehicle file's own",
    excitation="what its terms ask for: each of their velocities alone and together, slow to fast",
    lookalikes=("linear_damping", "quadratic_damping", "cross_axis_drag", "body_lift"),
    words=(
        Words("forces", "terms of X, Y, Z", ("Y |v|^n v",)),
        Words("moments", "terms of K, M, N", ("N |v| v",)),
    ),
    structure=structure,
    parameters=(
        Parameter(
            "force",
            ("N",),
            "coefficient of each of `forces`: where every factor is 1",
            ("forces",),
            scale=(of_mass(1.0),),
            plausible=as_drag(force=True),
        ),
        Parameter(
            "moment",
            ("N m",),
            "coefficient of each of `moments`: where every factor is 1",
            ("moments",),
            scale=(of_moment(1.0),),
            plausible=as_drag(force=False),
        ),
        Parameter(
            "exponents",
            ("1",),
            "the powers written as `^n`, in the order of the terms",
            ("exponents",),
            LEAST_POWER,
            MOST_POWER,
            scale=(1.0,),
            plausible=between(LEAST_POWER, 3.0, "", "drag of separated flow grows as speed to 1.5 to 2.5"),
        ),
    ),
    kernel=formula,
    sentence=formula_sentence,
    identification=Identification(),
    advice=Advice(parted_by=(COASTING,)),
    roles=frozenset({Role.COMMANDED}),
)

EFFECTS = (FORMULA,)
