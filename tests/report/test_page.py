"""What the report says: figures and words from the tables, each where it belongs."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import studies
import synthetic

from hydro.core.diagnosis.findings import Diagnosis, Finding
from hydro.core.errors import DataError
from hydro.io import table, vehicle
from hydro.io.study import NO_FORCES
from hydro.report import plots, words
from hydro.report.diagnosis import SHARES
from hydro.report.page import render
from hydro.report.sources import Named, Sources, gather


class Text(HTMLParser):
    """The words of a page, those of each section apart, without scripts and styles."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.stack, self.section, self.found = [], "head", {"head": ""}
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in ("script", "style"):
            self.stack.append(tag)
        if tag in ("section", "footer"):
            self.section = dict(attrs)["id"] or ""
            self.found[self.section] = ""

    def handle_endtag(self, tag: str) -> None:
        if tag in ("script", "style"):
            self.stack.pop()

    def handle_data(self, data: str) -> None:
        if not self.stack:
            self.found[self.section] = " ".join(f"{self.found[self.section]} {data}".split())


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Sources:
    return gather([studies.write(tmp_path_factory.mktemp("study"))])


@pytest.fixture(scope="module")
def page(sources: Sources) -> dict[str, str]:
    return Text(render(sources)).found


def alone(kind: str, frame: pl.DataFrame) -> Sources:
    """A report on one table."""
    of = {"comparison": "comparisons", "diagnosis": "diagnoses", "replay": "replays", "metrics": "metrics"}
    named = Named("one.parquet", table.make(kind, frame, stage=kind))
    return Sources(**{of[kind]: (named,)}) if kind in of else Sources(**{kind: named})


# A study.


def test_the_sections_are_in_order(page: dict[str, str]) -> None:
    order = [
        "model",
        "ladder",
        "findings",
        "places",
        "next",
        "recorded",
        "leftover",
        "replay-0",
        "confusions",
    ]
    assert list(page) == ["head", *order, "provenance"]


def test_the_headline_has_the_errors_before_and_after(page: dict[str, str]) -> None:
    told = (
        "With ocean current added and the file's values re-estimated, the error 5 s ahead falls from 2.00 to "
        "0.200 m/s, and on held-out data "
    )
    assert f"{told}from 1.80 to 0.300." in page["head"]
    assert "The noise floor is 0.020 m/s" in page["head"]
    assert "10 % of this error remains" in page["model"]
    assert "17 % of this error remains" in page["model"]


def test_a_diagnosis_of_log_faults_alone_has_the_first_fault_as_headline() -> None:
    fault = Finding("log_fault", members=("cmd_1",), advice="thruster 1 pushes opposite to the file")
    found = Diagnosis((fault,), synthetic.vehicle(), (1.0, 1.0, 1.0))
    page = Text(render(alone("diagnosis", found.frame()))).found
    assert "The log has wrong values in cmd_1." in page["head"]


def test_failure_regimes_before_and_after_are_side_by_side(page: dict[str, str]) -> None:
    assert "Sway while turning right above 0.8 m/s 60 % in 20 % of the time" in page["places"]
    assert "in 20 % of the time; 90.0 N, 1.8 times the average" in page["places"]
    before, after = page["places"].split("With the findings added")
    assert "turning right" in before
    assert "Sway while braking 60 %" in after


def test_the_sessions_of_both_recordings_are_listed(page: dict[str, str]) -> None:
    told = page["recorded"]
    assert "8.00 minutes in 2 sessions of the recording, 1.50 minutes in 1 session of held-out data." in told
    assert "run-2 the recording 4.00 20.0" in told
    assert "run-3 held-out data 1.50 10.0" in told


def test_a_comparison_alone_lists_the_sessions_of_its_recording() -> None:
    row = studies.comparison().row(0, named=True)
    row |= {"level": "recording", "axis": "t", "by": "session", "place": "run-1", "rows": 1200, "rmse": 0.05}
    frame = studies.comparison().vstack(
        pl.DataFrame([row], schema=studies.comparison().schema).with_columns(unit=pl.lit("s"))
    )
    page = Text(render(alone("comparison", frame))).found
    assert "1.00 minutes in 1 session." in page["recorded"]
    assert "run-1 1.00 20.0" in page["recorded"]


def test_the_unexplained_force_is_printed_with_its_sign(page: dict[str, str]) -> None:
    told = page["leftover"]
    assert (
        "X at surge −0.80 m/s: the force of the file is 80.0 N, and 16.0 N (15.0 to 17.0) is unexplained: "
        in told
    )
    assert "this log needs 20 % more." in told
    assert "Y N v = −0.80 m/s 80.0 16.0 15.0 to 17.0 0 −1.00 to 1.00 6.0" in told


def test_a_missing_unexplained_force_has_its_reason() -> None:
    why = {NO_FORCES: "samples are of u in 10%"}
    made = table.make("sessions", studies.sessions(), stage="explain", parameters=why)
    page = Text(render(Sources(sessions=Named("sessions.parquet", made)))).found
    assert page["leftover"].endswith("Not computed: Samples are of u in 10%.")


def test_commands_have_a_lane_for_each_thruster(sources: Sources) -> None:
    page = render(sources)
    assert 'data-chart="commands-0"' in page
    names = [one.name for one in vehicle.parse(studies.TEXT).thruster]
    assert all(f'"ticktext":["{name}"]' in page for name in names)
    without = studies.replay().drop(pl.selectors.starts_with("cmd_"))
    assert "commands-0" not in render(alone("replay", without))


def test_a_simulated_path_is_broken_at_each_restart() -> None:
    drawn = {one.name: one for one in plots.path(studies.replay(), "run-1", restart=5.0).data}
    assert np.isnan(drawn["model as given"].y).sum() == 3
    assert not np.isnan(drawn["measured"].y).any()


def test_a_finding_has_its_confidence(page: dict[str, str]) -> None:
    told = page["findings"]
    assert "Without it 41 % (33 to 52 %) of the squared error returns; tether fits as well." in told
    assert "(very likely, 93 %)" in told
    assert "Probability of such a share by chance: 0.0005." in told
    assert "v_N 0.260 ± 0.012 m/s" in told
    assert "Nothing missing Noise explains the remaining error." in told
    assert "thruster gain or quadratic damping (20 % of the squared error)" in told
    assert "More: hydro effects ocean_current ." in told


def test_new_values_of_the_file_are_a_finding_of_the_first_step(page: dict[str, str]) -> None:
    assert "New values of linear damping" in page["findings"].split("After step 1")[0]


def test_shares_of_findings_have_a_note() -> None:
    page = Text(render(alone("diagnosis", studies.found()))).found
    assert page["findings"].count(SHARES) == 1


def test_the_ladder_is_also_a_table(page: dict[str, str]) -> None:
    assert "0 the file as given the recording 2.00" in page["ladder"]
    assert "1 ocean current held-out data 0.300" in page["ladder"]
    assert "ocean current v_N 0.260 ± 0.012 m/s" in page["ladder"]


def test_the_overlay_has_the_errors_of_both_models(page: dict[str, str]) -> None:
    assert "model as given 0.200 0.200 0.200" in page["replay-0"]
    assert "after step 1 0.100 0.100 0.100" in page["replay-0"]
    assert "restarts from the measured motion every 20 s" in page["replay-0"]


def test_confusions_list_rivals_and_the_motion_that_separates_them(page: dict[str, str]) -> None:
    assert "ocean current fits as well here tether" in page["confusions"]
    assert "turn slowly through all headings" in page["confusions"]


def test_hashes_are_at_the_end_of_the_page(page: dict[str, str], sources: Sources) -> None:
    for one in sources.everything:
        assert one.artefact.provenance.content in page["provenance"]
    assert 'name = "ocean_current"' in page["provenance"]


def test_the_page_needs_no_network(sources: Sources) -> None:
    page = render(sources)
    own = re.sub(r"<script>.*?</script>", "", page, flags=re.S)
    assert "//" not in re.sub(r"/\*.*?\*/", "", own)
    assert "default-src 'none'" in own


def test_a_step_with_a_higher_held_out_error_is_not_the_one_to_use(tmp_path: Path) -> None:
    studies.write(tmp_path)
    worse = studies.ladder().with_columns(
        rmse=pl.when(pl.col("dataset") == "holdout", pl.col("step") == 1).then(9.0).otherwise("rmse")
    )
    table.write(table.make("ladder", worse, stage="explain"), tmp_path / "ladder.parquet")
    page = Text(render(gather([tmp_path]))).found
    assert "The error of the model is 2.00 m/s 5 s ahead." in page["head"]
    assert "the file to use is that of step 0" in page["ladder"]
    assert "With the findings added" not in page["places"]


def test_steps_are_sorted_by_number(tmp_path: Path) -> None:
    for step in (10, 2, 0):
        frame = studies.comparison(1.0, f"in step {step}")
        table.write(table.make("comparison", frame, stage="compare"), tmp_path / f"comparison-{step}.parquet")
    names = [one.name for one in gather([tmp_path]).comparisons]
    assert names == ["comparison-0.parquet", "comparison-2.parquet", "comparison-10.parquet"]


# Single tables.


@pytest.mark.parametrize(
    ("kind", "frame", "sections", "told"),
    [
        ("comparison", studies.comparison(), ["model", "places"], "The error of the model is 2.00 m/s"),
        ("diagnosis", studies.found(), ["findings", "next", "confusions"], "The model lacks ocean current."),
        ("diagnosis", studies.nothing(), ["findings", "next"], "Noise explains the remaining error."),
        ("ladder", studies.ladder(), ["model", "ladder"], "With ocean current added"),
        ("leftover", studies.leftover(), ["leftover"], "the force that its file does not explain"),
        ("sessions", studies.sessions(), ["recorded"], "Sessions of a study."),
        ("replay", studies.replay(), ["replay-0"], "Measured motion against simulated."),
        ("metrics", studies.metrics(), ["metrics-0"], "Errors of models, axis by axis."),
    ],
)
def test_a_single_table_gives_the_sections_that_it_supports(
    kind: str, frame: pl.DataFrame, sections: list[str], told: str
) -> None:
    page = Text(render(alone(kind, frame))).found
    assert list(page) == ["head", *sections, "provenance"]
    assert told in page["head"]


def test_metrics_have_a_row_per_variant() -> None:
    page = Text(render(alone("metrics", studies.metrics()))).found
    assert "MJ4 0.0100 0.0200 0.0300 0.0400 0.0500 0.0600" in page["metrics-0"]


def test_advice_for_the_next_run_has_no_duplicates() -> None:
    page = Text(render(alone("diagnosis", studies.found()))).found
    for advice in (
        "To separate them: fly a powered step.",
        "It grows with depth: fly deeper.",
        "Fly shallow.",
    ):
        assert page["next"].count(advice) == 1
    assert "hydro add" not in page["next"]


def test_the_head_names_one_next_step() -> None:
    of_finding = Text(render(alone("diagnosis", studies.found()))).found
    assert "Next: add all 3 corrections to the vehicle file, with hydro add ." in of_finding["head"]
    assert "hydro add" not in of_finding["findings"]
    study = Text(render(alone("ladder", studies.ladder()))).found
    assert "Next: use vehicle-1.toml in the folder of this study." in study["head"]


def test_a_comparison_with_an_earlier_one_shows_both_errors() -> None:
    frame = studies.comparison(0.5).with_columns(before=2.0 * pl.col("rmse"))
    page = Text(render(alone("comparison", frame))).found
    assert "With the findings added, the error 5 s ahead falls from 2.00 to 1.00 m/s." in page["head"]


def test_values_that_are_not_toml_are_refused() -> None:
    broken = studies.found().with_columns(parameters=pl.lit("{ v_N = "))
    with pytest.raises(
        DataError, match=r"values of ocean_current are not inline TOML.*run `hydro diagnose` again"
    ):
        render(alone("diagnosis", broken))


def test_two_ladders_are_refused(tmp_path: Path) -> None:
    studies.write(tmp_path)
    with pytest.raises(DataError, match="second study"):
        gather([tmp_path, tmp_path / "ladder.parquet"])


# Words.


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (2.0, "2.00"),
        (0.0123456, "0.0123"),
        (-151.26, "−151"),
        (9.996, "10.0"),
        (1.5e-7, "1.50e−07"),
    ],
)
def test_numbers_have_three_significant_figures(value: float, text: str) -> None:
    assert words.figure(value) == text


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.26591, 0.0141, "0.266 ± 0.014"),
        (188.34, 17.3, "188 ± 17"),
        (-0.0137, 0.0131, "−0.014 ± 0.013"),
        (2.0, None, "2.00"),
        (12345.0, 2345.0, "12300 ± 2300"),
    ],
)
def test_a_value_is_rounded_to_its_standard_error(value: float, error: float | None, text: str) -> None:
    assert words.with_error(words.Value("x", value, error, "")) == text


@pytest.mark.parametrize(
    ("effect", "parameters", "name", "unit"),
    [
        ("ocean_current", "{ v_N = 0.2 }", "v_N", "m/s"),
        ("linear_damping", "{ diagonal = [1, 2, 3, 4, 5, 6] }", "diagonal N", "N m s"),
        ("thruster_gain", "{ g = [0, 0, 0, 0, 0, -0.4] }", "g 6", ""),
        ("sensor_misalignment", "{ alpha = [0.1, 0.2, 0.3] }", "alpha yaw", "rad"),
        ("tether", "{ attachment = [0.1, 0.2, 0.3] }", "attachment z", "m"),
    ],
)
def test_entries_are_named_by_their_axes(effect: str, parameters: str, name: str, unit: str) -> None:
    last = words.values(effect, parameters, "")[-1]
    assert (last.name, last.unit) == (name, unit)


def test_prose_is_an_escaped_sentence() -> None:
    told = words.prose("add <b>ocean_current</b> with `hydro add`; nu_r")
    expected = "Add &lt;b&gt;ocean current&lt;/b&gt; with <code>hydro add</code>; nu_r."
    assert str(told) == expected
