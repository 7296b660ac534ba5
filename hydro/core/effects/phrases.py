"""Sentences shared by similar effects: missing components, changed components, and displacements."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from hydro.core.effects.case import Case, Quantity, estimate
from hydro.core.effects.wording import (
    AXES,
    CLOSE_DIGITS,
    LEAST_PART,
    MOST_DIGITS,
    capital,
    compass,
    known,
    listed,
    number,
    quantity,
    sides,
    superscript,
    uncertainty,
    without_uncertainty,
)

LONGEST = 220
"""Maximum length of a sentence in characters: three lines of a terminal."""
MOST_ENTRIES = 3
"""Maximum number of components with a standard error in a sentence."""
MOST_OTHERS = 5
"""Maximum number of further components in a sentence: with the first one, all six axes."""
CLOSE_RATIO = 0.1
"""Relative change below which a value is written with CLOSE_DIGITS digits."""
PLAIN_RATIO = 100.0
"""Largest ratio to the file's value that is written as a ratio."""
COORDINATES = frozenset({"m", "s", "rad", "°"})
"""Units of places, times and angles, which are written as values: their ratios have no meaning."""

Sentence = Callable[[Case], str]


UNDETERMINED = "not determined by this log."
"""End of a sentence on a value of a missing effect that a log does not determine."""
UNCLEAR = "does not differ clearly from"
"""Words about a value of the file that a log does not determine; the value in the file follows them."""


class Entry(NamedTuple):
    """Component (one number) of an effect, with the words that describe it.

    Attributes:
        label: Full name of the component, such as `heave drag`.
        part: Words after its value, such as `in heave`.
        quantity: Fitted value, standard error and value in the vehicle file.
        unit: Unit of the quantity.
    """

    label: str
    part: str
    quantity: Quantity
    unit: str


def undetermined(case: Case, subject: str, value: str) -> str:
    """Return a sentence for a value that the log does not determine.

    If the vehicle file has the effect, the sentence states that the value does not differ from the file's.

    Args:
        case: Values of the effect.
        subject: Name of the undetermined quantity.
        value: Estimate in words.
    """
    if case.in_file:
        return f"{capital(subject)} {UNCLEAR} {case.old_value}."
    said = f", {value}," if case.finite and not case.brief else ""
    return f"{capital(subject)}{said} is {UNDETERMINED}"


def most_telling(entries: Iterable[Entry]) -> list[Entry]:
    """Return a new list of components, sorted by the difference from the file's value, the largest first.

    Differences are compared in standard errors, then in size.
    """
    return sorted(entries, key=lambda one: (one.quantity.deviations, abs(one.quantity.change)), reverse=True)


def shortened(render: Callable[[int], str], most: int = MOST_ENTRIES) -> str:
    """Return the sentence with as many components as fit into `LONGEST` characters, at least one component.

    Args:
        render: Function from a number of components to the sentence with so many components.
        most: Maximum number of components.
    """
    return first_that_fits(render(count) for count in range(most, 0, -1))


def first_that_fits(sentences: Iterable[str]) -> str:
    """Return the first sentence that fits into `LONGEST` characters; the last one if none fits."""
    text = ""
    for text in sentences:
        if len(text) <= LONGEST:
            break
    return text


def listing(clear: Sequence[Entry], brief: bool, render: Callable[[int, bool], str]) -> str:
    """Return a sentence that lists components, the most significant components with their standard errors.

    Args:
        clear: Components, the most significant first.
        brief: Whether only the first component is written, and all others are counted.
        render: Function that returns the sentence.  Arguments: the number of components with standard errors,
            and whether all other components are written (True) or only counted.
    """
    if brief:
        return render(1, False)
    counts = range(min(MOST_ENTRIES, len(clear)), 0, -1)
    forms = [(count, whole) for whole in (True, False) for count in counts]
    forms = [(count, whole) for count, whole in forms if not whole or len(clear) - count <= MOST_OTHERS]
    return first_that_fits(render(*form) for form in forms)


def stated(case: Case, noun: str, entries: Sequence[Entry]) -> str:
    """Return a sentence on the components of an effect.

    If the file has the effect, the sentence compares its values with the file's; else it states what the file
    lacks.

    Args:
        case: Values of the effect.
        noun: Name of the force or inertia, as in `quadratic damping`.
        entries: All components.
    """
    return changed(case, noun, entries) if case.in_file else missing(case, noun, entries)


def missing(case: Case, noun: str, entries: Sequence[Entry]) -> str:
    """Return a sentence on components that the file lacks: "Drag of 284 N s²/m² (±6) in heave is missing".

    Args:
        case: The values of the effect.
        noun: Name of the force or inertia, as in `quadratic damping`.
        entries: All components.
    """
    order = most_telling(entries)
    clear = [one for one in order if one.quantity.clear]
    if not order:
        return f"{capital(noun)} is {UNDETERMINED}"
    if not clear:
        return undetermined(case, noun, valued(order[0]))
    if len(clear) == 1:
        return f"{capital(noun)} of {valued(clear[0])} is missing."

    def render(count: int, whole: bool) -> str:
        rest = [without_error(one) for one in clear[count:]] if whole else more(len(clear) - count, "value")
        return f"{capital(noun)} is missing: {listed([*map(valued, clear[:count]), *rest])}."

    return listing(clear, case.brief, render)


def valued(entry: Entry) -> str:
    """Return the value of a component as text, with its error and words: `3 N s/m (±1) in heave`."""
    return f"{entry.quantity.text(entry.unit)} {entry.part}".strip()


def without_error(entry: Entry) -> str:
    """Return the value of a component as text, with unit and words: `3 N s/m in heave`."""
    return f"{quantity(entry.quantity.value, unit=entry.unit)} {entry.part}".strip()


def changed(case: Case, noun: str, entries: Sequence[Entry]) -> str:
    """Return a sentence on the difference from the file: "Heave drag is 1.3 times the file's value (…)".

    Args:
        case: Values of the effect.
        noun: Name of the force or inertia.
        entries: All components.
    """
    order = most_telling(entries)
    clear = [one for one in order if one.quantity.clear]
    if not clear:
        if not order or not order[0].quantity.change:
            return f"{capital(noun)} is {case.as_given}."
        return f"{capital(against_file(order[0], case.old_value))}, within its uncertainty."

    if case.brief:
        count = len(clear) - 1
        numbered = f"{count} more value{'s' * (count > 1)} of {noun} change{'s' * (count == 1)}"
        others = f"; {numbered}" if count else ""
        return f"{capital(against_file(clear[0], case.old_value))}{others}."

    def render(count: int, whole: bool) -> str:
        named = [
            against_file(one, "" if place else case.old_value) for place, one in enumerate(clear[:count])
        ]
        rest = [against_file(one) for one in clear[count:]] if whole else []
        rest = [*map(without_uncertainty, rest)] or more(len(clear) - count, "change")
        return capital(listed([*named, *rest])) + "."

    return listing(clear, False, render)


def more(left: int, noun: str = "") -> list[str]:
    """Return words for omitted components, such as `3 more values`, as a list of one item.

    Args:
        left: Number of omitted components; the list is empty for 0.
        noun: Name of one component, such as `value`; by default the words are `3 more`.
    """
    return [f"{left} more {noun}{'s' * (left > 1 and bool(noun))}".strip()] if left > 0 else []


def against_file(entry: Entry, old_value: str = "") -> str:
    """Return words that compare a component with its value in the file, as a simple ratio or as both values.

    Args:
        entry: The component.
        old_value: Words for the value in the file if the component is the first of its sentence, such as "the
            file's value"; empty for the others, which repeat neither these words nor the verb.
    """
    value, error, before = entry.quantity
    unit = superscript(entry.unit)
    ratio = value / before if before else math.inf
    digits = CLOSE_DIGITS if abs(ratio - 1.0) < CLOSE_RATIO else MOST_DIGITS
    is_, was = "is " if old_value else "", number(before, most=digits)
    if entry.unit in COORDINATES or not 1.0 / PLAIN_RATIO <= ratio <= PLAIN_RATIO:
        now, _, doubt = quantity(value, error, entry.unit).partition(" (")
        old = quantity(before, unit=entry.unit)
        return f"{entry.label} {is_}{now} ({doubt.replace(')', ', ')}was {old})"
    times = next((text for n in (2, 3, 4) if (text := f"{ratio:.{n}g}") != "1"), f"{ratio:.5g}")
    doubt = f" ± {uncertainty(value, error, digits)}" if known(error) else ""
    gap = "" if unit in ("", "°") else " "
    both = f"({number(value, error, digits)}{doubt}, was {was}{gap}{unit})"
    of = f"{old_value} " if old_value else ""
    return f"{entry.label} {is_}{times} times {of}{both}"


def coordinates(whose: str, point: Sequence[Quantity]) -> list[Entry]:
    """Return three components: the coordinates of a point of the body [m], FRD, with words that name them.

    Args:
        whose: Name of the point's owner, such as `the DVL's`.
        point: Forward, starboard and downward coordinate.
    """
    ways = ("forward", "starboard", "downward")
    return [Entry(f"{whose} {side} position", "", one, "m") for side, one in zip(ways, point, strict=True)]


def diagonal(
    noun: str, label: str, units: tuple[str, str, str], symmetric: bool = False, key: str = "diagonal"
) -> Sentence:
    """Return the sentence function of an effect given by six diagonal entries or by a full 6x6 matrix.

    Args:
        noun: Name of the force or inertia, as in `quadratic damping`.
        label: Name of a component without its axis, as in `drag` for "heave drag".
        units: Units of the force, mixed and moment blocks of the matrix.
        symmetric: Whether components below the diagonal repeat those above.
        key: The parameter of the diagonal.
    """

    def sentence(case: Case) -> str:
        diagonals = case.many(key, (6,))
        straight = [
            Entry(f"{axis} {label}", f"in {axis}", one, units[2 * (i >= 3)])
            for i, (axis, one) in enumerate(zip(AXES, diagonals, strict=True))
        ]
        if "matrix" not in case.values and "matrix" not in (case.before or {}):
            return stated(case, noun, straight)
        return stated(case, noun, of_matrix(case, label, units, symmetric, key))

    return sentence


def of_matrix(
    case: Case, label: str, units: tuple[str, str, str], symmetric: bool, key: str = "diagonal"
) -> list[Entry]:
    """Return the components of a 6x6 matrix as a list, each with its value in the vehicle file.

    Args:
        case: Values of the effect; both fit and file may give `matrix` or only the diagonal.
        label: Name of a component without its axes, as in `drag`.
        units: Units of the force, mixed and moment blocks of the matrix.
        symmetric: Whether components below the diagonal repeat those above, and are left out.
        key: Name of the parameter with the diagonal.
    """
    whole, line = case.many("matrix", (6, 6)), case.many(key, (6,))
    form, old = "matrix" in case.values or key not in case.values, "matrix" in (case.before or {})
    entries = []
    for i in range(6):
        for j in range(i if symmetric else 0, 6):
            here, there = whole[6 * i + j], line[i] if i == j else Quantity(0.0)
            value, error = (here if form else there)[:2]
            one = Quantity(value, error, here.before if old else there.before)
            name = AXES[i] if i == j else f"{AXES[i]}-{AXES[j]}"
            entries.append(Entry(f"{name} {label}", f"in {name}", one, units[(i >= 3) + (j >= 3)]))
    return entries


def coefficients(noun: str, named: Sequence[tuple[str, str, str, str]]) -> Sentence:
    """Return the sentence function of an effect whose parameters are single named coefficients.

    Args:
        noun: Name of the force or inertia, as in `coupled damping`.
        named: For each coefficient its parameter name, unit, full name, and the words after its value.
    """

    def sentence(case: Case) -> str:
        return stated(
            case, noun, [Entry(label, part, case.one(key), unit) for key, unit, label, part in named]
        )

    return sentence


def force_per_speed(i: int, j: int) -> str:
    """Return words for the force on axis i per velocity on axis j, such as `yaw moment per sway speed`."""
    force, speed = "moment" if i >= 3 else "force", "rate" if j >= 3 else "speed"
    return f"{AXES[i]} {force} per {AXES[j]} {speed}"


def along_body(changes: Sequence[Quantity], unit: str, least: float) -> list[str]:
    """Return text for each significant component of a body vector, such as `0.020 m (±0.001) forward`.

    If all components have the same standard error, it is written once.

    Args:
        changes: Three quantities, FRD; their differences from the file are written.
        unit: Their unit.
        least: Size below which a component without a standard error is negligible.
    """
    vector = [one.change for one in changes]
    most = max(map(abs, vector))
    kept = [
        (one, side)
        for one, side in zip(changes, sides(*vector), strict=True)
        if one.clear and (known(one.error) or abs(one.change) >= max(least, LEAST_PART * most))
    ]
    errors = {uncertainty(one.change, one.error) for one, _ in kept}
    pieces = []
    for place, (one, side) in enumerate(kept):
        text = one.changed(unit)
        pieces.append(f"{text.partition(' (±')[0] if place and len(errors) == 1 else text} {side}")
    return pieces


def displaced(point: str, verb: str, keys: Sequence[str] | str, where: str) -> Sentence:
    """Return the sentence function for a point of the body: how far it is from its place in the file.

    Args:
        point: Name of the point.
        verb: `lies` or `sits`.
        keys: Three parameters, or one of three numbers [m], FRD.
        where: Name of the place that the file assumes.
    """

    def sentence(case: Case) -> str:
        three = case.many(keys, (3,)) if isinstance(keys, str) else [case.one(key) for key in keys]
        pieces = along_body(three, "m", 5e-4)
        if pieces:
            of = "" if pieces[-1].endswith(("above", "below")) else "of "
            return f"{capital(point)} {verb} {listed(pieces)} {of}{where}."
        far = max(three, key=lambda one: one.deviations)
        return undetermined(case, f"the place of {point}", far.changed("m"))

    return sentence


def beyond(key: str, unit: str, subject: str, words: str, sides: tuple[str, str]) -> Sentence:
    """Return the sentence function for a parameter that is added to a value of the vehicle, with its sign.

    Args:
        key: Name of the parameter.
        unit: Unit in which the parameter is written; `%` for a fraction.
        subject: Name of the parameter, for a log that does not determine it.
        words: The sentence without its full stop, with `{change}` and `{side}`.
        sides: Words for more and for less than in the file.
    """

    def sentence(case: Case) -> str:
        one = case.one(key).times(100.0 if unit == "%" else 1.0)
        if not one.clear:
            return undetermined(case, subject, one.text(unit))
        told = words.format(change=one.changed(unit), side=sides[one.change <= 0.0])
        return told + (case.sampled(one.change) if unit == "s" else "") + "."

    return sentence


def horizontal(north: Quantity, east: Quantity) -> Quantity:
    """Return the length of a horizontal vector with its standard error, and the length in the vehicle file.

    Args:
        north: Component toward north: fitted value, standard error and the file's value.
        east: Component toward east, likewise.
    """
    length, before = math.hypot(north.value, east.value), math.hypot(north.before, east.before)
    if not length:
        return estimate(0.0, max(north.error, east.error), before)
    pairs = [(one.value, one.error) for one in (north, east) if not math.isnan(one.error)]
    error = math.sqrt(sum((value * error) ** 2 for value, error in pairs if value)) / length if pairs else 0.0
    return Quantity(length, error if error > 0.0 else math.nan, before)


def toward(size: str, north: float, east: float) -> str:
    """Return text for a horizontal vector: its length and compass heading.

    Args:
        size: Text of the length.
        north: Component toward north, in any unit.
        east: Component toward east, in the same unit.
    """
    return f"{size} toward {compass(north, east)}"


def horizontal_change(
    north: Quantity, east: Quantity, unit: str, factor: float = 1.0
) -> tuple[str, str, bool]:
    """Return words for a fitted horizontal vector, for the file's, and whether they clearly differ.

    Args:
        north: Component toward north.
        east: Component toward east.
        unit: Unit of the words, after multiplication by `factor`.
        factor: Factor from the unit of the components to `unit`.
    """
    north, east = north.times(factor), east.times(factor)
    length = horizontal(north, east)
    if length.before:
        old = toward(quantity(length.before, unit=unit), north.before, east.before)
        clear = north.clear or east.clear
    else:
        old, clear = f"0 {unit}", Quantity(length.value, length.error).clear
    return toward(length.text(unit), north.value, east.value), old, clear
