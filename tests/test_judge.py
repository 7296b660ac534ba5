"""The scoreboard of the diagnosis: scoring, paired differences, re-scoring, and one study from end to end."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recordings import damped

from benchmarks.hidden_effects import vehicles
from benchmarks.imperfect_logs.study import CONDITIONS
from benchmarks.judge import __main__ as command
from benchmarks.judge import board, candidates, rescore, rows
from benchmarks.judge import results as files
from benchmarks.judge.candidates import BLOCKS, in_blocks
from benchmarks.judge.scores import Score, score
from benchmarks.judge.studies import LISTS, Study
from benchmarks.work import Results
from hydro.core.diagnosis import confidence, settings
from hydro.core.diagnosis.by_change import Change, Changes
from hydro.core.diagnosis.contenders import Contender
from hydro.core.diagnosis.findings import Diagnosis, Finding
from hydro.core.vehicle.description import Vehicle

BASE = dict.fromkeys(rows.SCHEMA) | {"list": "clean-one", "seed": 1, "seconds": 60.0, "failure": ""}
BASE |= {"called": ["payload"], "alias": [], "misjudged": [], "study_cpu": 1.0, "cpu": 1.0, "role": "finding"}


def finding(effect: str, sure: float, verdict: str = "missing", **more: object) -> dict:
    return BASE | {"effect": effect, "members": [effect], "confidence": sure, "verdict": verdict, **more}


def test_first_name_counts_and_every_statement_must_be_right():
    both = score([finding("payload", 0.95), finding("tether", 0.92)])
    assert (both.first, both.stated, both.wrong, both.exact) == (True, True, True, False)
    assert both.brier == pytest.approx(0.05**2)
    doubtful = score([finding("tether", 0.5, "suspect"), finding("payload", 0.95)])
    assert (doubtful.first, doubtful.wrong) == (False, False)
    assert score([finding("payload", 0.8)]).stated is False


def test_alias_and_values_wrong_by_design_are_neither_right_nor_wrong():
    row = {"alias": ["net_buoyancy"], "misjudged": ["linear_damping"]}
    told = score([finding("net_buoyancy", 0.99, **row), finding("linear_damping", 0.99, "retune", **row)])
    assert told.named == ()
    assert not told.wrong
    assert score([finding("linear_damping", 0.99, "missing", **row)]).wrong


HIDDEN = json.dumps({"hidden": [], "foreign": {"swell": 2.0}})


def test_an_effect_outside_the_catalogue_is_called_unknown_and_no_alarm_counts_it():
    outside = {"called": [], "hidden": HIDDEN, "title": "swell"}
    told = score([finding("", None, "none_of_the_known", members=[], **outside)])
    assert (told.outside, told.unexplained, told.answer) == (True, True, None)
    named = score([finding("tether", 0.95, **outside)])
    assert (named.unexplained, named.wrong, named.alarm) == (False, True, False)
    assert not score([finding("payload", 0.95, hidden=HIDDEN)]).outside, "an effect of the catalogue fits it"


COLUMNS = json.dumps({"hidden": [], "foreign": {"columns": [2, 4]}})


@pytest.mark.parametrize(
    ("members", "hidden", "right"),
    [
        (["cmd_4", "cmd_2"], COLUMNS, True),
        (["cmd_2"], COLUMNS, False),
        (["cmd_2", "cmd_3"], COLUMNS, False),
        (["cmd_2"], None, True),
        (["psi"], json.dumps({"hidden": [], "foreign": {"sensor": "heading"}}), True),
    ],
    ids=["those at fault", "too few", "others", "not known", "no column"],
)
def test_a_fault_of_the_log_is_right_if_it_names_the_columns_at_fault(members, hidden, right):
    row = {"list": "apart-before", "called": ["log_fault"], "hidden": hidden}
    row |= {"effect": "", "members": members, "verdict": "log_fault"}
    told = score([BASE | row])
    assert (told.first, told.wrong) == (right, not right)
    assert told.answer.stated, "a fault is a statement"
    assert score([BASE | row | {"list": "clean-one"}]).answer is None


@pytest.mark.parametrize(
    ("told", "first", "wrong"),
    [
        ([finding("control_surface:2", 0.95, "retune", called=["control_surface"])], True, False),
        ([finding("ocean_current", 1.0), finding("current_shear", 1.0)], True, False),
        ([finding("ocean_current", 1.0)], False, False),
        ([finding("tether", 0.4, "suspect"), finding("current_shear", 0.95)], False, False),
        ([finding("current_shear", 0.8, "suspect"), finding("tether", 0.95)], True, True),
        ([finding("", None, "nothing_missing", members=[])], False, False),
    ],
    ids=["label", "alias first", "alias alone", "wrong suspect first", "wrong statement later", "nothing"],
)
def test_changes_of_the_independent_simulator_are_scored_by_right_names_and_aliases(told, first, wrong):
    where = {"list": "apart-before", "alias": ["ocean_current"]}
    called = {"called": told[0]["called"] if told[0]["effect"].startswith("control") else ["current_shear"]}
    one = score([row | where | called for row in told])
    assert (one.first, one.wrong) == (first, wrong)


def test_nothing_hidden_makes_any_statement_an_alarm():
    assert score([finding("tether", 0.95, called=[])]).alarm
    assert not score([finding("tether", 0.5, "suspect", called=[])]).alarm
    assert not score([finding("tether", 0.95)]).alarm


def test_a_tie_is_no_first_name_and_no_statement():
    tied = score([finding("payload", 0.97, "cannot_tell_apart", members=["payload", "tether"])])
    assert (tied.first, tied.stated, tied.wrong) == (False, False, False)


def test_values_are_parted_into_affected_and_unaffected_entries():
    told = score([finding("payload", 0.95, off=[0.5, -3.0, 1.0], affected=[True, False, True])])
    assert told.off == (0.5, 1.0)
    assert told.unaffected == (-3.0,)


@pytest.mark.parametrize(
    ("after", "truth", "helped"),
    [(0.14, 0.1, True), (0.16, 0.1, False), (0.14, 0.19, None)],
    ids=["halves", "does not", "nor would the truth"],
)
def test_an_addition_helps_where_it_halves_the_error_above_the_floor(after, truth, helped):
    errors = {"before": 0.2, "floor": 0.1, "with_truth": truth, "after_top": after}
    assert score([finding("payload", 0.95, **errors)]).helped is helped


def test_all_stated_findings_are_added_where_several_effects_are_hidden():
    errors = {"before": 0.2, "floor": 0.1, "with_truth": 0.1, "after_top": 0.19, "after": 0.11}
    assert score([finding("payload", 0.95, called=["payload", "tether"], **errors)]).helped
    assert not score([finding("payload", 0.95, called=["payload"], **errors)]).helped


@given(st.integers(0, 30), st.integers(0, 30), st.integers(0, 30))
def test_interval_of_paired_shares_holds_the_difference_and_is_never_empty(gained, lost, same):
    if gained + lost + same == 0:
        return
    before = np.array([0.0] * gained + [1.0] * lost + [1.0] * same)
    after = np.array([1.0] * gained + [0.0] * lost + [1.0] * same)
    low, high = board.of_shares(before, after)
    middle = (gained - lost) / (len(before) + 2.0)
    assert low < middle < high
    mirrored = board.of_shares(after, before)
    assert mirrored == pytest.approx((-high, -low))


def test_paired_differences_use_only_studies_that_both_have_and_that_did_not_fail():
    right, wrong = [finding("payload", 0.95)], [finding("tether", 0.95)]

    def of(seed: int, told: list[dict], failure: str = "") -> Score:
        return score([row | {"seed": seed, "failure": failure} for row in told])

    base = [of(1, right), of(2, wrong), of(3, right, "broke"), of(4, right)]
    now = [of(1, right), of(2, right), of(3, right)]
    text = board.paired(base, now, "old", "new")
    assert text.startswith("2 pairs: new minus old")
    assert "| all | named first | 2 | 50.0% | 100.0% | +50.0 |" in text


STUDIES = [
    score([finding("payload", 0.97, title="payload", seed=1)]),
    score([finding("tether", 0.6, "suspect", title="payload", seed=2)]),
    score([finding("tether", 0.95, list="clean-none", called=[], seed=1)]),
    score([finding("", None, "nothing_missing", members=[], list="clean-none", called=[], seed=2)]),
    score([finding("payload", 0.95, title="payload + tether", seed=3, failure="DataError: diverges")]),
    score([finding("payload", 0.95, title="payload + tether", seed=4, called=["payload", "tether"])]),
]
UNKNOWN = score(
    [
        finding("", None, "far_from_noise", members=[], list="clean-unknown")
        | {"called": [], "hidden": HIDDEN, "title": "swell"}
    ]
)


def test_the_scoreboard_counts_lists_and_leaves_empty_columns_out():
    cells = {row["list"]: row for row in board.table(STUDIES)}
    assert cells["clean-one"]["studies"] == "3"
    assert cells["clean-one"]["named first"].startswith("2 of 3, 67% (")
    assert cells["clean-one"]["exactly"].startswith("1 of 3,")
    assert cells["clean-none"]["alarm"].startswith("1 of 2,")
    assert cells["clean-one"]["alarm"] == ""
    assert "called unknown" not in cells["all"]
    text = board.scoreboard(STUDIES)
    assert "Statements at 0.9 or more: 3; studies with a wrong one: 1 of 5." in text
    assert "Failed: ('clean-one', 3, 60.0): DataError: diverges" in text
    with_unknown = board.table([*STUDIES, UNKNOWN])
    assert with_unknown[0]["called unknown"].startswith("1 of 1,")
    assert with_unknown[0]["alarm"] == cells["all"]["alarm"]


def test_confusions_list_first_answers_of_studies_that_hide_one_effect_or_none():
    text = board.confusions([*STUDIES, UNKNOWN])
    assert "| payload | 2 | **payload** 1, tether 1 |" in text
    assert "| nothing | 2 | tether 1, **nothing** 1 |" in text
    assert "| swell | 1 | **none of the known** 1 |" in text
    assert "payload + tether" not in text


FROZEN = Path(__file__).resolve().parents[1] / "benchmarks" / "results" / "judge-7389b25.parquet"


def test_without_lists_the_sizes_are_those_of_the_frozen_table():
    studies = pl.read_parquet(FROZEN).unique(["list", "seed"])
    kept = dict(studies.group_by("list").len().rows())
    assert {name: count for name, count in command.sizes([]).items() if count} == kept
    assert studies.height == 263
    assert command.sizes(["clean-one", "clean-form=7"]) == {"clean-one": 50, "clean-form": 7}
    with pytest.raises(SystemExit, match="give clean-form=COUNT"):
        command.sizes(["clean-form"])


def test_every_condition_of_a_log_is_a_list_with_and_without_a_hidden_effect():
    for name in ("logs", "logs-none"):
        assert [one.about for each, one in LISTS.items() if each.startswith(f"{name}:")] == list(CONDITIONS)


def test_a_study_of_several_files_is_that_of_the_last_one(tmp_path):
    tables = [[finding("payload", 0.95), finding("tether", 0.9)], [finding("payload", 0.8)]]
    tables[0].append(finding("tether", 0.5, seed=2))
    paths = [tmp_path / f"{number}.parquet" for number in range(2)]
    for told, path in zip(tables, paths, strict=True):
        pl.DataFrame(told, schema=rows.SCHEMA).write_parquet(path)
    found = files.read(paths)
    assert found.select("seed", "confidence").rows() == [(2, 0.5), (1, 0.8)]
    words = "python -m benchmarks.judge run --list clean-one=2 --first-seed 1 --seconds 60"
    assert files.made_by(found) == words
    later = found.with_columns(pl.col("seed") + 100)
    both = f"{words}; {words.replace('--first-seed 1', '--first-seed 101')}"
    assert files.made_by(pl.concat([found, later])) == both
    pl.DataFrame({"seed": [1]}).write_parquet(paths[0])
    with pytest.raises(SystemExit, match=r"0\.parquet holds no results"):
        files.read(paths)


def test_a_results_file_of_an_older_schema_is_continued(tmp_path):
    path = tmp_path / "old.parquet"
    pl.DataFrame([finding("payload", 0.9)], schema=rows.SCHEMA).drop("support").write_parquet(path)
    Results(path, rows.SCHEMA).add(finding("payload", 0.9, support=0.95))
    found = pl.read_parquet(path)
    assert found.schema == pl.Schema(rows.SCHEMA)
    assert found["support"].to_list() == [None, 0.95]


@pytest.mark.parametrize(("left", "stated"), [(1.1, 0.9), (1.9, 0.9), (4.0, 0.9 * 102 / 118)])
def test_a_row_keeps_what_the_confidence_of_its_finding_was_made_from(left, stated):
    """Where more than noise is left, a name is less sure than the share of resamples that it wins."""
    sure = confidence.by_likelihood_confidence(0.9, left <= settings.RIGHT)
    told = (Finding("missing", "payload", confidence=sure, support=0.9), Finding("not_excited", "tether"))
    (row,) = rows._findings(Study(None, None, ()), Diagnosis(told, None, (9.0, 9.0, left)))
    assert row["confidence"] == pytest.approx(stated)
    assert row["support"] == 0.9


def test_a_delay_that_only_the_log_has_is_not_added_for_the_error_on_clean_data():
    vehicle = vehicles.preset("auv151")

    class Effects:
        """Stands for the errors ahead: tells which effects a vehicle has beside the file's."""

        floor = 0.0

        def of(self, given: Vehicle) -> list[str]:
            return [table["name"] for table in given.effect[len(vehicle.effect) :]]

    late = Finding("missing", "sensor_delay", parameters={"d": 0.2}, confidence=1.0)
    load = Finding("missing", "payload", parameters={"w": 3.0}, confidence=1.0)
    doubtful = Finding("retune", "tether", parameters={"k": 3.0}, confidence=0.5)
    found = Diagnosis((late, load, doubtful), vehicle, (9.0, 9.0, 1.0))
    for of_log, after in (((), ["sensor_delay", "payload"]), (("sensor_delay",), ["payload"])):
        errors = rows._errors(Study(vehicle, None, ("payload",), errors=Effects(), of_log=of_log), found)
        assert errors["after"] == after
        assert errors["after_top"] == after[:1]


def test_a_study_that_fails_is_a_row(tmp_path):
    (row,) = rows.run("clean-none", 0, 4.0, tmp_path)
    assert row["failure"].startswith("DataError: ")
    assert (row["list"], row["seed"], row["role"]) == ("clean-none", 0, "none")


def test_a_log_is_written_as_files(tmp_path):
    arguments = ["write", "--list", "logs-none:filtered", "--seed", "3", "--seconds", "24", "-o"]
    chosen = command.parser().parse_args([*arguments, str(tmp_path / "study")])
    chosen.action(chosen)
    names = ["after.parquet", "held_out.parquet", "truth.json", "vehicle.toml"]
    assert sorted(path.name for path in (tmp_path / "study").iterdir()) == names
    truth = json.loads((tmp_path / "study" / "truth.json").read_text())
    assert (truth["called"], truth["condition"]) == (["sensor_delay"], "filtered")
    assert truth["hidden"] == []
    assert pl.read_parquet(tmp_path / "study" / "after.parquet").height == 1200


@given(st.integers(1, 700), st.integers(1, 40))
def test_kept_blocks_are_few_multiples_of_the_block_length_and_lose_nothing(shots, size):
    costs = np.random.default_rng(shots).random(shots)
    blocks = in_blocks(costs, size)
    assert len(blocks) <= BLOCKS
    assert blocks.sum() == pytest.approx(costs.sum())


def test_exactly_one_candidate_of_a_step_is_marked_as_chosen():
    """The best change of a step that was taken, and of one that was refused the model without any."""
    model = cast(Any, SimpleNamespace(vehicle=damped(), values=np.zeros(1)))
    rivals = {name: Contender(name, model, np.ones(8)) for name in ("thruster_gain", "buoyancy_offset")}
    change = Change(rivals["thruster_gain"], rivals, np.full(8, 2.0), 1.0)
    compared = SimpleNamespace(chi2=lambda _: 1.0)
    regime = cast(Any, SimpleNamespace(compared=compared, first=model))
    for refused in (None, change):
        listed = candidates.of_changes(regime, Changes((change,), refused))
        chosen = [(one["step"], one["effect"]) for one in listed if one["chosen"]]
        assert chosen == [(0, "thruster_gain"), (1, "")][: 1 if refused is None else 2]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One study with one hidden effect, from end to end."""
    path = tmp_path_factory.mktemp("judge") / "now.parquet"
    arguments = ["run", "--list", "clean-one=1", "--first-seed", "9", "--seconds", "60", "-o", str(path)]
    chosen = command.parser().parse_args(arguments)
    chosen.action(chosen)
    return path


def test_a_study_from_end_to_end_keeps_findings_and_candidates(results: Path):
    table = pl.read_parquet(results)
    assert table["failure"].unique().to_list() == [""]
    tried = table.filter(role="candidate")
    assert tried.filter("chosen").height >= 1
    assert tried["engine"].unique().to_list() == ["likelihood"]
    one = command.scored(table)[0]
    assert one.row["after"] <= one.row["before"]
    text = board.scoreboard([one])
    assert "| all | 1 |" in text


def test_the_same_command_goes_on_where_it_stopped(results: Path, capsys: pytest.CaptureFixture[str]):
    before = results.read_bytes()
    chosen = command.parser().parse_args(
        ["run", "--list", "clean-one=1", "--first-seed", "9", "--seconds", "60", "-o", str(results)]
    )
    chosen.action(chosen)
    assert results.read_bytes() == before
    assert "1/1" not in capsys.readouterr().out


def test_decisions_on_kept_candidates_are_those_of_the_diagnosis(results: Path):
    table = pl.read_parquet(results)
    stated, again = command.scored(table)[0], rescore.rescored(table, {})[0]
    assert [one.members for one in again.named] == [one.members for one in stated.named]
    assert again.named[0].confidence == pytest.approx(stated.named[0].confidence, abs=0.05)


def candidate(effect: str, **more: object) -> dict:
    return BASE | {"role": "candidate", "effect": effect, "plausible": True} | more


def again(names: dict[str, float], *told: dict) -> dict[str, float]:
    """Return the findings that other confidences give, in order."""
    return {row["effect"]: row["confidence"] for row in rescore._renamed(told, names)}


def test_findings_keep_their_order_and_new_names_take_the_places_of_old_ones():
    error = finding("sensor_bias", 1.0)
    told = (error, finding("payload", 0.9), finding("tether", 0.8), candidate("payload"), candidate("tether"))
    assert list(again({"tether": 0.7, "payload": 0.6}, *told)) == ["sensor_bias", "payload", "tether"]
    found = again({"added_mass": 0.7, "tether": 0.6}, *told)
    assert found == {"sensor_bias": 1.0, "added_mass": 0.7, "tether": 0.6}
    assert list(again({"added_mass": 0.7, "payload": 0.6, "tether": 0.5}, *told))[-1] == "added_mass"
    assert list(again({}, *told)) == ["sensor_bias"]


@pytest.mark.parametrize(("told", "expected"), [(0.95, 0.97), (0.5, 0.5), (0.1, 0.5)])
def test_a_name_beyond_its_range_is_limited_unless_the_diagnosis_was_surer(told, expected):
    rows_ = (finding("payload", told), candidate("payload", plausible=False), candidate("tether"))
    assert rescore._limited(rows_, {"payload": 0.97, "tether": 0.9}) == {"payload": expected, "tether": 0.9}


@pytest.mark.parametrize(("told", "part"), [(0.4, 0.4), (0.86441, 1.0), (1.0, 1.0), (None, 1.0)])
def test_a_discount_that_candidates_do_not_show_is_that_of_the_diagnosis(told, part):
    rows_ = (finding("payload", told, support=1.0), finding("tether", 0.1))
    found = rescore._discounted(rows_, {"payload": 0.9, "tether": 0.8})
    assert found == pytest.approx({"payload": 0.9 * part, "tether": 0.8})


def test_a_name_without_a_confidence_has_no_brier_score():
    assert score([finding("payload", None, "retune")]).brier is None
    assert score([finding("payload", 0.0)]).brier == 1.0


def test_another_constant_changes_the_decision_and_is_set_back(results: Path):
    table, kept = pl.read_parquet(results), settings.RIGHT_ABOVE
    again = rescore.rescored(table, {"settings.RIGHT_ABOVE": 0.1, "settings.RIGHT": 0.0})[0]
    assert again.named[0].confidence <= 0.1
    assert kept == settings.RIGHT_ABOVE == confidence.RIGHT_ABOVE


def test_an_unknown_constant_and_an_unknown_list_are_refused_in_a_line():
    with pytest.raises(SystemExit, match=r"not a constant of a kept decision"):
        rescore.parsed(["settings.NOPE=1"])
    with pytest.raises(SystemExit, match="not a number"):
        rescore.parsed(["settings.RIGHT=much"])
    with pytest.raises(SystemExit, match="give NAME"):
        command.sizes(["clean-four"])
