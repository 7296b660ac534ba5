"""Diagnosis as text: headline, errors of predictions, a block for each finding, and the next command."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from hydro.core import toml_text
from hydro.core.columns import UNITS
from hydro.core.diagnosis.findings import STATED, UNEXPLAINED, Diagnosis, Prediction
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.status import in_words, percent
from hydro.core.effects import CATALOGUE
from hydro.core.effects.sentences import sentence
from hydro.core.effects.wording import capital
from hydro.core.errors import listed
from hydro.core.vehicle.description import Vehicle
from hydro.report import words
from hydro.report.following import Call
from hydro.report.next_steps import ADD, COMPARE, CONTINUE, CORRECT, EXPLAIN, FIT, RUN, NextStep, next_steps
from hydro.report.screen import EMPTY, MOST_LINES, Block, Following, Text, fitted, table

TITLES = {
    "log_fault": "The log has a fault",
    "missing": "{Effect}",
    "suspect": "{Effect}, unconfirmed",
    "retune": "New values of {effect}",
    "cannot_tell_apart": "{Members}",
    "not_separable": "No log can separate {effect} from effects of the file",
    "none_of_the_known": "An error remains that no effect explains",
    "far_from_noise": "An error remains that no effect explains",
    "closed_loop": "The log was recorded under feedback: a controller may hide a disturbance",
}
"""Title of a finding by its verdict."""
CHANGED = {"missing": "{Effect} has changed", "suspect": "{Effect} may have changed"}
"""Titles that differ for changes since an earlier recording."""
SILENT = ("nothing_missing", "not_excited", "not_separable")
"""Verdicts without a block: the headline or the line on effects that are not visible has them."""
MOST_UNSEEN = 4
"""Maximum number of effects in the line on effects that are not visible."""
MORE = "{count}, not shown: add --details."
"""Note on findings that do not fit on the screen."""
SHARES = "Shares of the squared error above the noise overlap; they need not sum to 100 %."
"""Note on the shares of findings."""
SURENESS = "Percentage after a name: probability that it is right; ±: standard error."
"""Note on the confidence and the standard errors of findings."""
UNCONFIRMED = "Unconfirmed: the confidence in the name is below 90 %."
"""Note on findings whose title says so."""
DIAGNOSE_ONLY = ("--discover", "--correct-thrusters", "--known")
"""Options of `hydro diagnose` that `hydro compare` does not have."""
FLIP = "reverse thrusters in the vehicle file"
"""Words for the step that corrects thrusters which are reversed but not swapped."""


@dataclass(frozen=True)
class Context:
    """Data for the text of a diagnosis, besides the table of findings.

    Attributes:
        vehicle: The vehicle file.
        dt: Sample time of the recording [s].
        headline: The status in one line.
        prediction: Prediction errors before and after the findings are added; None if not known.
        changed: Whether findings are changes since an earlier recording.
        open: Whether `--next-run` can design manoeuvres for another recording.
        call: The command; None if the answer has no next command.
        learned: Sentences on the hull-force model of a recording before a change; empty without one.
        reversed: Thrusters that push opposite to the file, from 0; empty if columns are swapped as well.
    """

    vehicle: Vehicle
    dt: float = math.nan
    headline: str = ""
    prediction: Prediction | None = None
    changed: bool = False
    open: bool = False
    call: Call | None = None
    learned: str = ""
    reversed: tuple[int, ...] = ()

    @classmethod
    def of(
        cls, found: Diagnosis, vehicle: Vehicle, log: Preprocessed, call: Call, learned: str = ""
    ) -> Context:
        """Return the context (data other than the findings) of a diagnosis that was just made.

        Args:
            found: The diagnosis.
            vehicle: The vehicle file.
            log: The recording after preprocessing.
            call: The command.
            learned: Sentences on the hull-force model of a recording before a change; empty without one.
        """
        changed, asked, dt = bool(learned), found.question is not None, log.record.dt
        wrong = log.audit.wiring if log.audit is not None and log.audit.wrong else None
        flipped = wrong.reversed if wrong is not None and not wrong.moved else ()
        return cls(vehicle, dt, found.headline, found.prediction, changed, asked, call, learned, flipped)

    @property
    def refused(self) -> bool:
        """Whether `hydro add` refuses the confirmed findings: they do not lower the prediction error."""
        return self.prediction is not None and self.prediction.refuted


def answer(frame: pl.DataFrame, about: Context, width: int, *, whole: bool = False) -> list[Text]:
    """Return a diagnosis as lines of a terminal: the headline, the next command, errors, and findings.

    Args:
        frame: Diagnosis table.
        about: Other data of the answer.
        width: Columns.
        whole: Whether all findings and alternative commands are shown, even if they do not fit on the screen.
    """
    head = [Text(about.headline, bold=True)] if about.headline else []
    first, *others = commands(frame, about) or [Following()]
    if first.words:
        head += [EMPTY, *first.lines(width)]
    if about.prediction is not None:
        head += [EMPTY, *errors(about.prediction)]
    rows = [row for row in frame.sort("rank").iter_rows(named=True) if _has_block(row)]
    key = [Text(SURENESS)] * any(sureness(row) for row in rows)
    notes = [Text(SHARES)] * has_shares(rows) + [Text(UNCONFIRMED)] * has_unconfirmed(rows)
    notes += look_up([row["effect"] for row in rows])
    tail = [EMPTY, Text(about.learned)] if about.learned else []
    tail += unseen(frame, about)
    if whole and others:
        tail += [EMPTY, Text("Instead of the next command:", bold=True)]
        tail += [line for one in others for line in one.lines(width)]
    blocks = list(_blocks(rows, about))
    for told in ([*key, *notes], notes):  # the key to percentages goes before a finding does
        end = [EMPTY, *told, *tail] if told else tail
        complete = fitted(head, blocks, end, width, "")
        if whole or len(complete) <= MOST_LINES:
            return complete
    return fitted(head, blocks, end, width, MORE)


def commands(frame: pl.DataFrame, about: Context) -> list[Following]:
    """Return the recommended next command, then its alternatives, as commands to be pasted.

    Args:
        frame: Diagnosis table.
        about: Other data of the answer.
    """
    found: list[Following] = []
    for step in next_steps(frame, about.prediction):
        told = FLIP if step.action == CORRECT and about.reversed else step.words
        label = f"{capital(told)}:" if found else f"Next: {told}:"
        if words_of := _command(step, about, alone=not found):
            found.append(Following(label, words_of))
    return found


def _command(step: NextStep, about: Context, *, alone: bool) -> list[str] | None:
    """Return the words of a step's command; None if it has none, or if the inputs cannot be read again.

    Args:
        step: The step.
        about: Other data of the answer.
        alone: Whether no other command of the answer may write `vehicle-1.toml`.
    """
    call = about.call
    if call is None:
        return None
    if step.action == ADD:
        name, *_ = (*step.effects, "found")
        return call.adding(*step.effects, into="" if alone else name.partition(":")[0])
    if step.action == CORRECT:
        if about.reversed:
            return call.flipping(about.reversed)
        return call.again("diagnose", "--correct-thrusters") if step.words == CONTINUE else None
    if step.action == EXPLAIN:
        return call.again("explain", "-o", "study")
    if step.action == RUN:
        return call.designing() if about.open else None
    if step.action == FIT:
        return call.fitting(*step.effects)
    assert step.action == COMPARE
    return call.again("compare", without=DIAGNOSE_ONLY)


def _has_block(row: Mapping[str, Any]) -> bool:
    """Return whether the text shows a finding as a block of its own; the headline shows faults of the log."""
    return row["verdict"] not in (*SILENT, "log_fault")


def errors(known: Prediction) -> Iterator[Text]:
    """Yield the lines of a table of prediction errors, one line per axis: as given, corrected, noise floor.

    Args:
        known: Errors before and after the findings are added.
    """
    after, floor = known.added != known.given, known.floor is not None
    names = ["as given", "corrected"] if after else ["error"]
    rows = [(axis, UNITS[axis], each) for axis, each in known.axes.items()]
    rows.append(("all", "m/s", [known.given, known.added, known.floor]))
    header = [f"Error {known.horizon:g} s ahead", *names, *(["noise floor"] if floor else [])]
    yield from table(
        header,
        (
            [f"  {axis} [{unit}]", *(words.figure(each[i]) for i in _columns(after, floor))]
            for axis, unit, each in rows
        ),
    )
    if after:
        helps = " This does not lower the error, so hydro add refuses it." if known.refuted else ""
        yield Text(f"Errors on stretches left out of the fits{_above(known)}.{helps}")


def _above(known: Prediction) -> str:
    """Return a clause on the remaining error as a multiple of the noise floor; empty without the latter."""
    if not known.floor:
        return ""
    times = known.added / known.floor
    place = (
        "at the noise floor" if times <= words.AT_FLOOR else f"{words.figure(times)} times the noise floor"
    )
    return f"; all axes together: {place}"


def _columns(after: bool, floor: bool) -> list[int]:
    """Return the indices of the columns to show out of 0 (as given), 1 (with findings), 2 (noise floor)."""
    return [0, *([1] if after else []), *([2] if floor else [])]


def _blocks(rows: Sequence[dict[str, Any]], about: Context) -> Iterator[Block]:
    """Yield a block for each finding, confirmed ones first."""
    stated = [row for row in rows if row["verdict"] in STATED]
    others = [row for row in rows if row["verdict"] not in STATED]
    for place, row in enumerate([*stated, *others], 1):
        yield Block([EMPTY, *finding(row, about, place if len(rows) > 1 else 0)])


def finding(row: Mapping[str, Any], about: Context, number: int = 0) -> Iterator[Text]:
    """Yield the paragraphs on one finding: title with confidence, sentence on its values, and its share.

    Args:
        row: Row of the diagnosis table.
        about: Other data of the answer.
        number: Number of the finding in the list; 0 if it is the only one.
    """
    place = f"{number}. " if number else ""
    sure = sureness(row)
    yield Text(f"{place}{title(row, about)}{f': {sure}' if sure else ''}.", bold=True)
    told = said(row, about)
    if told and told.rstrip(".") not in about.headline:
        yield Text(told, len(place))
    if known := facts(row):
        yield Text(known, len(place))


def title(row: Mapping[str, Any], about: Context) -> str:
    """Return the title of a finding with verdict and effect, such as `New values of payload, unconfirmed`.

    Args:
        row: Row of the diagnosis table.
        about: Other data of the answer.
    """
    names = TITLES | (CHANGED if about.changed else {})
    effect = words.effect_name(row["effect"])
    members = listed([words.effect_name(name) for name in row["members"]], "or")
    template = names[row["verdict"]]
    if row["verdict"] == "suspect" and about.vehicle.effects(row["effect"]):
        template = "New values of {effect}, unconfirmed"
    return template.format(Effect=capital(effect), effect=effect, Members=capital(members))


def said(row: Mapping[str, Any], about: Context) -> str:
    """Return the sentence on the fitted values of a finding; empty without values.

    If the table has none, the sentence compares the values with those of the vehicle file.

    Args:
        row: Row of the diagnosis table.
        about: Other data of the answer.
    """
    if not row["parameters"] or row["effect"] not in CATALOGUE:
        return ""
    if row.get("sentence"):
        return str(row["sentence"])
    values, errors = (toml_text.value(row[name] or "{}") for name in ("parameters", "standard_errors"))
    return sentence(about.vehicle, row["effect"], values, errors, about.dt)


def sureness(row: Mapping[str, Any]) -> str:
    """Return the confidence in a finding as text, or else its p-value; empty without both.

    Args:
        row: Row of the diagnosis table.
    """
    if not row["parameters"] or row["verdict"] == "cannot_tell_apart":
        return ""
    if row["confidence"] is not None:
        return in_words(row["confidence"])
    if row["verdict"] not in STATED:
        return in_words(math.nan)
    return "" if row["p_value"] is None else f"significant, {words.p_value(row['p_value'])}"


def facts(row: Mapping[str, Any]) -> str:
    """Return a sentence: a finding's share of the squared error above the noise, and equally good effects.

    Args:
        row: Row of the diagnosis table.
    """
    share = row["share_of_error_explained"]
    if share is None or not (row["parameters"] or row["verdict"] in UNEXPLAINED):
        return ""
    if row["verdict"] in UNEXPLAINED:
        return f"{words.percent(share)} of the squared error remains."
    told = _share(row)
    rivals = [words.effect_name(name) for name in row["members"] if name != row["effect"]]
    if row["verdict"] == "cannot_tell_apart":
        sure = "" if row["confidence"] is None else f" ({percent(row['confidence'])} for the first)"
        return f"{told}; this log does not tell which{sure}."
    if rivals:
        return f"{told}; {listed(rivals)} {'fits' if len(rivals) == 1 else 'fit'} as well."
    return f"{told}; no other is close." if row["verdict"] == "missing" else f"{told}."


def _share(row: Mapping[str, Any]) -> str:
    """Return the share of the error above the noise that a finding removes, in words."""
    low, high = row["share_low"], row["share_high"]
    told = words.percent(row["share_of_error_explained"])
    if row["verdict"] == "retune" and low is None:
        return f"The file's old values cause {told} of its squared error"
    if low is not None and high is not None and (interval := words.between(low, high)) != told:
        told = f"{told} ({interval})"
    if row["verdict"] in STATED:
        return f"Without it {told} of the squared error returns"
    return f"It removes {told} of the squared error"


def has_shares(rows: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether any finding of the rows states a share of the error, which a note must then explain."""
    return any(facts(row) for row in rows)


def has_unconfirmed(rows: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether any finding of the rows is unconfirmed, so that a note must explain this."""
    return any(row["verdict"] == "suspect" for row in rows)


def look_up(effects: Sequence[str]) -> list[Text]:
    """Return a line with the command that explains the first effect of the catalogue among `effects`.

    Args:
        effects: Names of effects, the most important first.

    Returns:
        A list of one line; an empty list without such an effect.
    """
    known = [name.partition(":")[0] for name in effects if name in CATALOGUE]
    return [Text(f"Look up an effect: hydro effects {known[0]}")] if known else []


def unseen(frame: pl.DataFrame, about: Context) -> Iterator[Text]:
    """Yield lines on effects that the recording cannot show, with the manoeuvre that would show the first.

    Args:
        frame: Diagnosis table.
        about: Other data of the answer.
    """
    names = frame.filter(verdict="not_excited").sort("rank")["effect"].unique(maintain_order=True).to_list()
    if not names:
        return
    shown = [words.effect_name(name) for name in names[:MOST_UNSEEN]]
    if more := len(names) - len(shown):
        shown.append(f"{more} more")
    yield EMPTY
    motion, what = capital(CATALOGUE[names[0]].excitation), "it" if len(names) == 1 else shown[0]
    told = f"Not visible in this log: {listed(shown)}. {motion} would show {what}"
    yield Text(f"{told}; --next-run FILE designs that run." if about.open and about.call else f"{told}.")


def details(frame: pl.DataFrame) -> Iterator[tuple[str, pl.DataFrame, str]]:
    """Yield the findings of a diagnosis, best first, as triples of a title, a table and a text.

    Args:
        frame: Diagnosis table.

    Yields:
        Title; table with the columns `parameter`, `value`, `standard error` and `unit`; and a text with the
        sentence on the finding, the p-value of its test, and the advice.
    """
    for row in frame.sort("rank").iter_rows(named=True):
        effect = words.effect_name(row["effect"]) or listed(row["members"])
        values = words.values(row["effect"], row["parameters"], row["standard_errors"])
        shown = pl.DataFrame(
            [(one.name, one.value, one.error, one.unit) for one in values],
            ["parameter", "value", "standard error", "unit"],
            orient="row",
        )
        label = words.verdict(row)[0]
        title = f"{capital(effect)}: {label.lower()}" if effect else label
        test = "" if row["p_value"] is None else f"{words.p_value(row['p_value'])}."
        told = (row.get("sentence"), test, words.sentence(row["advice"]))
        yield title, shown, " ".join(filter(None, told))


def fits(chi2: Sequence[float]) -> str:
    """Return a sentence on the reduced chi-squares of a diagnosis.

    Args:
        chi2: Reduced chi-square of the file as given, with its effects re-estimated, and with the findings.
    """
    given, own, found = chi2
    return (
        f"Reduced chi-square (1: noise alone): {given:.3g} of the file, {own:.3g} with its own effects "
        f"re-estimated, {found:.3g} with the findings added."
    )
