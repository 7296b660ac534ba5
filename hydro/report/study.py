"""Study (diagnosis that adds effects step by step) as text: headline, errors, steps, next command."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from hydro.core.columns import UNITS
from hydro.core.effects.catalogue import implausible
from hydro.core.effects.wording import capital
from hydro.core.evaluation.yardsticks import LEAST_SQUARES, column
from hydro.core.explanation.ladder import HORIZON, LEFT_OUT, Step
from hydro.core.explanation.status import UNCONFIRMED, added
from hydro.core.explanation.with_hull import FLOOR
from hydro.report import ladder, words, yardsticks
from hydro.report.diagnosis import look_up
from hydro.report.screen import EMPTY, Block, Following, Text, fitted, table

WHERE = {"fit": "on the recording", "holdout": "on held-out data"}
"""Names of the data sets in sentences."""
MORE = "{count}, not shown: add --details."
"""Note on corrections that do not fit on the screen."""
MOST = 2
"""Maximum number of implausible values with a sentence, so that the answer fits one screen."""


@dataclass(frozen=True)
class Outcome:
    """Completed study.

    Attributes:
        steps: Steps of the study.
        chosen: The step to use.
        headline: Overall result in one line.
        reason: Reason why the study ended.
        folder: Folder of its files.
        corrections: Sentence for each correction of the file, with its values and standard errors.
    """

    steps: Sequence[Step]
    chosen: Step
    headline: str
    reason: str
    folder: Path
    corrections: Sequence[str] = ()

    @property
    def file(self) -> Path:
        """Path of the vehicle file to use."""
        return self.folder / f"vehicle-{self.chosen.number}.toml"

    @property
    def chosen_effects(self) -> list[str]:
        """Names of the effects that the steps up to the chosen one added."""
        return [name for step in self.steps[: self.chosen.number + 1] for name in step.added]

    @property
    def rungs(self) -> pl.DataFrame:
        """Ladder of the study: the prediction errors of all steps in one table."""
        return pl.concat([step.ladder for step in self.steps], how="diagonal_relaxed")

    @property
    def beyond(self) -> list[str]:
        """A sentence for each fitted value of the chosen step that is not physically plausible."""
        return implausible(self.chosen.vehicle, [table["name"] for table in self.chosen.tables])


def answer(study: Outcome, width: int) -> list[Text]:
    """Return the result of a study as lines of a terminal: headline, errors, steps and the next command.

    Args:
        study: The study.
        width: Columns of the terminal.
    """
    head = [Text(study.headline, bold=True), EMPTY, *errors(study)]
    rungs = study.rungs
    simple = yardsticks.of_ladder(rungs, study.chosen.number, yardsticks.judged_on(rungs))
    if told := yardsticks.sentence(simple):
        head.append(Text(told))
    changed = not rungs.filter(axis=FLOOR).is_empty()
    own = "the file's own values are held" if changed else "each re-estimates the file's own values, too"
    lines = [EMPTY, Text(f"Steps; {own}:", bold=True), *_steps(study)]
    if not all(added(study.steps).values()):
        lines.append(
            Text(f"{UNCONFIRMED.capitalize()}: it predicts better, but its name has a confidence below 90 %.")
        )
    lines += [Text(f"It ends here: {study.reason}."), *look_up(study.chosen_effects), EMPTY]
    beyond = study.beyond
    lines += [Text(f"Not plausible, so it may stand for something else: {one}") for one in beyond[:MOST]]
    if (more := len(beyond) - MOST) > 0:
        lines.append(Text(f"{more} more values are not plausible: add --details."))
    lines.append(Text(f"The file to use is {study.file}."))
    page = ["hydro", "report", str(study.folder), "-o", "report.html"]
    lines += Following("All figures on one page:", page).lines(width)
    return fitted(head, list(_corrections(study)), lines, width, MORE)


def _corrections(study: Outcome) -> Iterator[Block]:
    """Yield a block for each correction with its standard errors; none if the headline states them all."""
    if all(one in study.headline for one in study.corrections):
        return
    for place, told in enumerate(study.corrections):
        title = [EMPTY, Text("Corrections, ± standard error:", bold=True)] if place == 0 else []
        yield Block([*title, Text(f"{place + 1}. {told}", indent=2)])


def errors(study: Outcome) -> Iterator[Text]:
    """Yield the lines of a table with the errors of the first and the chosen step, one line per axis.

    Args:
        study: The study.
    """
    rungs = study.rungs
    dataset = yardsticks.judged_on(rungs)
    rows = rungs.filter(pl.col("horizon") == HORIZON, dataset=dataset)
    axes = ladder.measured(rows)
    first, last = (
        {row["axis"]: row for row in rows.filter(step=number).iter_rows(named=True)}
        for number in (0, study.chosen.number)
    )
    both = study.chosen.number > 0
    simple = column(LEAST_SQUARES)
    names = [*(["as given", "corrected"] if both else ["error"]), "noise floor"]
    has_simple = simple in rows.columns and rows[simple].count() > 0
    header = [f"Error {HORIZON:g} s ahead", *names, *([LEAST_SQUARES] if has_simple else [])]
    body = []
    for axis in axes:
        values = [first[axis]["rmse"], *([last[axis]["rmse"]] if both else []), last[axis]["noise_floor"]]
        values += [last[axis][simple]] if has_simple else []
        unit = UNITS.get(axis, "m" if axis == "pose" else "m/s")
        body.append([f"  {axis} [{unit}]", *(words.figure(one) for one in values)])
    yield from table(header, body)
    if both:
        yield Text(f"{capital(WHERE[dataset])}; corrected: the file of step {study.chosen.number}.")


def _steps(study: Outcome) -> Iterator[Text]:
    """Yield a line for each step: added effects, whether they are confirmed, and the decisive error."""
    confirmed = added(study.steps)
    for step in study.steps:
        use = ", the one to use" if step is study.chosen and len(study.steps) > 1 else ""
        yield Text(f"{step_line(step, confirmed)}{use}", indent=2)


def step_line(step: Step, confirmed: Mapping[str, bool]) -> str:
    """Return one line on a step: its number, the effects that it added, and the error that decides.

    Args:
        step: The step.
        confirmed: Whether each added effect is confirmed, by the effect's name.
    """
    names = [
        words.effect_name(name) + ("" if confirmed[name] else f" ({UNCONFIRMED})") for name in step.added
    ]
    return f"{step.number}, {', '.join(names) or 'the file as given'}: {deciding(step)}"


def deciding(step: Step) -> str:
    """Return, in words, the error of a step by which steps are compared.

    It is the error on held-out data, else on data left out of the fits, else on the recording.
    """
    rows = step.ladder
    if not (held := rows.filter(dataset="holdout")).is_empty():
        place, rows = WHERE["holdout"], held
    else:
        place = "on left-out data"
        if not (left := rows.filter(axis=LEFT_OUT)).is_empty():
            return f"error {words.figure(left['rmse'][0])} m/s {place}"
        place = WHERE["fit"]
    if not (times := rows.filter(axis=FLOOR)).is_empty():
        return f"error {times['rmse'][0]:.2f} times that before the change, {place}"
    ahead = rows.filter(horizon=HORIZON)
    whole = ahead.filter(axis=ladder.measured(ahead)[-1])
    return f"error {words.figure(whole['rmse'][0])} {whole['unit'][0]} {place}"
