"""Names of effects, verdicts and numbers as text for reports."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup, escape

from hydro.core import toml_text
from hydro.core.columns import DOF, POSE, WRENCH
from hydro.core.effects import CATALOGUE
from hydro.core.effects.record import Parameter
from hydro.core.errors import DataError, listed
from hydro.core.interval import NORMAL_95
from hydro.core.prediction.parameters import unit_at

VERDICTS = {
    "log_fault": ("Fault in the log", "The log has wrong values in {columns}."),
    "missing": ("New effect", "The model lacks {effect}."),
    "suspect": ("Unconfirmed", "The model may lack {effect}; the confidence is below 90 %."),
    "retune": ("New values", "This log needs new values of {effect}."),
    "cannot_tell_apart": (
        "Ambiguous",
        "The model lacks {members}; this log does not tell which.",
    ),
    "not_separable": ("Not separable", "No log can separate {effect} from effects of the file."),
    "not_excited": ("Not visible", "The motion in this log cannot show {effect}."),
    "none_of_the_known": ("Unexplained", "An error remains that no effect of the catalogue explains."),
    "closed_loop": ("Feedback", "A controller reacts to the motion and may hide a disturbance."),
    "far_from_noise": (
        "Unexplained",
        "An error of many times the noise remains, and no effect of the catalogue explains it.",
    ),
    "nothing_missing": ("Nothing missing", "Noise explains the remaining error."),
}
"""Label and sentence of each verdict."""
OF_CHANGE = {
    "missing": ("Changed", "The {effect} has changed."),
    "suspect": ("Unconfirmed", "The {effect} may have changed; the confidence is below 90 %."),
    "cannot_tell_apart": ("Ambiguous", "The {members} has changed; this log does not tell which."),
    "nothing_missing": (
        "No change found",
        "No change stands out from the error of the hull-force model.",
    ),
}
"""Labels and sentences that differ for changes since an earlier recording."""

AT_FLOOR = 1.05
"""Ratio of an error to the noise floor up to which the floor is reached: both are estimates."""

DATASETS = {"fit": "the recording", "holdout": "held-out data"}
"""Names of the data sets of a ladder."""

EFFECT_NAMES = re.compile(rf"\b({'|'.join(name for name in CATALOGUE if '_' in name)})\b")
"""Pattern of effect names in a text."""
QUOTED = re.compile("`([^`]*)`")
"""Pattern of commands in a text."""


@dataclass(frozen=True)
class Value:
    """One fitted number of an effect, for reports.

    Attributes:
        name: Parameter, with the axis or number of its component: `diagonal X`.
        value: The number.
        error: Standard error of the number; None without one.
        unit: Unit of the number.
    """

    name: str
    value: float
    error: float | None
    unit: str

    @property
    def interval(self) -> tuple[float, float] | None:
        """Lower and upper end of the 95 % interval of the number; None without a standard error."""
        if self.error is None:
            return None
        return self.value - NORMAL_95 * self.error, self.value + NORMAL_95 * self.error


def effect_name(name: str) -> str:
    """Return the name of an effect in words: `ocean_current` as `ocean current`."""
    return name.replace("_", " ")


def effects_named(names: str) -> str:
    """Return a list of effects in words: `a_b, c` as `a b and c`."""
    return listed([effect_name(name) for name in names.split(", ") if name])


def meaning(effect: str) -> str:
    """Return the first sentence of an effect's description; empty for an unknown effect."""
    return CATALOGUE[effect].description.partition("\n")[0] if effect in CATALOGUE else ""


def verdict(row: dict[str, Any], of_change: bool = False) -> tuple[str, str]:
    """Return two texts on a finding: a label of a few words, and a sentence.

    Args:
        row: The finding, a row of a diagnosis table.
        of_change: Whether the finding is a change since an earlier recording, not a missing effect.
    """
    label, sentence = (VERDICTS | (OF_CHANGE if of_change else {}))[row["verdict"]]
    members = listed([effect_name(name) for name in row["members"]], "or")
    effect, columns = effect_name(row["effect"]), listed(row["members"])
    return label, sentence.format(effect=effect, members=members, columns=columns)


def in_short(row: dict[str, Any]) -> str:
    """Return a finding in a few words: `tether (12 % of the squared error)`."""
    named = listed([effect_name(name) for name in row["members"] or [row["effect"]]], "or")
    share = row["share_of_error_explained"]
    return named if share is None else f"{named} ({percent(share)} of the squared error)"


def values(effect: str, parameters: str, errors: str) -> list[Value]:
    """Return the fitted numbers of an effect, one by one, with their standard errors.

    Args:
        effect: Name of the effect.
        parameters: Values by parameter, as the text of an inline TOML table.
        errors: Standard errors in the same form.

    Raises:
        DataError: The text is not inline TOML.
    """
    try:
        given, sure = (toml_text.value(text or "{}") for text in (parameters, errors))
    except DataError as error:
        raise DataError(
            f"the values of {effect} are not inline TOML ({error}); run `hydro diagnose` again"
        ) from None
    return fitted(effect, given, sure)


def fitted(effect: str, given: dict[str, Any], sure: dict[str, Any]) -> list[Value]:
    """Return the numbers in an effect's table, one by one, with their standard errors.

    Args:
        effect: Name of the effect.
        given: Values by parameter.
        sure: Standard errors by parameter.
    """
    records = {one.name: one for one in CATALOGUE[effect].parameters} if effect in CATALOGUE else {}
    texts = CATALOGUE[effect].written(given) if effect in CATALOGUE else {}
    found = []
    for name, value in given.items():
        if name in texts:
            continue
        terms = terms_of(records.get(name), texts)
        for index, number in _entries(value):
            unit = unit_at(records[name], index) if name in records else ""
            error = sure.get(name)
            for i in index:
                error = error[i] if isinstance(error, list) and i < len(error) else None
            label = terms[index[0]] if terms else _entry_name(records.get(name), name, index)
            found.append(Value(label, number, error, "" if unit == "1" else unit))
    return found


def terms_of(record: Parameter | None, texts: Mapping[str, Sequence[str]]) -> Sequence[str]:
    """Return the terms of a formula to which the numbers of a parameter belong, as texts.

    Args:
        record: The parameter in the catalogue; None if it is not there.
        texts: Written terms of the effect, by the name of the parameter that has them.

    Returns:
        The terms; () if the parameter does not belong to a formula.
    """
    length = record.shape[0] if record is not None and record.shape else None
    return texts.get(length, ()) if isinstance(length, str) else ()


def _entries(value: Any) -> Iterator[tuple[tuple[int, ...], float]]:
    """Yield the numbers of a nested list and their indices; a single number has the index ()."""
    if not isinstance(value, list):
        yield (), float(value)
        return
    for i, inner in enumerate(value):
        for index, number in _entries(inner):
            yield (i, *index), number


def _entry_name(record: Parameter | None, name: str, index: tuple[int, ...]) -> str:
    """Return the name of a component: `v_N`, `diagonal X`, `alpha pitch`, or with its number, `g 3`."""
    if not index:
        return name
    last = record.shape[-1] if record is not None and record.shape else None
    three = DOF[3:] if record is not None and record.unit == ("rad",) else POSE[:3]
    letters = {6: WRENCH, 3: three}.get(last, ()) if isinstance(last, int) else ()
    square = record is not None and record.shape == (6, 6)
    entries = [
        letters[i] if i < len(letters) and (square or k == len(index) - 1) else str(i + 1)
        for k, i in enumerate(index)
    ]
    return " ".join([name, *entries])


def by_unit(found: Sequence[Value]) -> list[list[Value]]:
    """Return values in groups of one unit, so that each group can share an axis."""
    units = list(dict.fromkeys(one.unit for one in found))
    return [[one for one in found if one.unit == unit] for unit in units]


def figure(value: float | None, digits: int = 3) -> str:
    """Return a number as text, in plain notation if that is short.

    `–` for None or a number that is not finite.

    Args:
        value: The number.
        digits: Number of significant figures.
    """
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    rounded = float(f"{value:.{digits - 1}e}")
    size = math.floor(math.log10(abs(rounded)))
    if not -4 <= size < 6:
        return f"{rounded:.{digits - 1}e}".replace("-", "−")
    return f"{rounded:.{max(0, digits - 1 - size)}f}".replace("-", "−")


def with_error(one: Value) -> str:
    """Return a value with its error, to the second figure of the error: `0.266 ± 0.014`."""
    if one.error is None or not one.error > 0.0 or not math.isfinite(one.error):
        return figure(one.value)
    places = 1 - math.floor(math.log10(one.error))
    if not -3 <= places <= 6:
        return f"{figure(one.value)} ± {figure(one.error, 2)}"
    shown = (f"{round(number, places):.{max(0, places)}f}" for number in (one.value, one.error))
    return " ± ".join(shown).replace("-", "−")


def percent(share: float | None) -> str:
    """Return a fraction as text in percent: `41 %`, `0.6 %`; `–` for None."""
    if share is None or not math.isfinite(share):
        return "–"
    return f"{100 * share:.0f} %" if share >= 0.0095 or share == 0.0 else f"{100 * share:.1g} %"


def between(low: float, high: float) -> str:
    """Return an interval of fractions as text in percent: `63 to 71 %`, or one number if both round alike."""
    first, last = percent(low), percent(high)
    return first if first == last else f"{first.removesuffix(' %')} to {last}"


def p_value(value: float) -> str:
    """Return a p-value as text with `p` and its sign: `p = 0.0005`, `p < 0.00001`."""
    text = probability(value)
    return f"p {text}" if text.startswith("<") else f"p = {text}"


def probability(value: float | None) -> str:
    """Return a probability as text: `0.0005`, or `< 0.00001` if it is smaller; `–` for None."""
    if value is None:
        return "–"
    return "< 0.00001" if value < 1e-5 else f"{value:.2g}" if value >= 1e-4 else f"{value:.5f}"


def horizon(seconds: float | None) -> str:
    """Return a horizon in words: `5 s ahead`, or `whole run`."""
    return "whole run" if seconds is None else f"{seconds:g} s ahead"


def prose(text: str) -> Markup:
    """Return a text of a diagnosis as a sentence in HTML, with effects in words and commands as code."""
    told = str(escape(sentence(text)))
    told = EFFECT_NAMES.sub(lambda found: effect_name(found[0]), told)
    return Markup(QUOTED.sub(r"<code>\1</code>", told))


def sentence(text: str) -> str:
    """Return `text` with a capital letter at the beginning and a full stop at the end.

    Empty text stays empty.
    """
    text = text.strip()
    return text if not text else f"{text[0].upper()}{text[1:]}{'' if text[-1] in '.!?' else '.'}"
