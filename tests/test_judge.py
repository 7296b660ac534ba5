"""The scoreboard of the diagnosis: scoring, paired differences, re-scoring, and one study from end to end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.judge import __main__ as command
from benchmarks.judge import board, rescore, rows
from benchmarks.judge.scores import Score, score
from hydro.core.diagnosis import confidence
from hydro.core.diagnosis.candidates import BLOCKS, in_blocks

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


@given(st.integers(1, 700), st.integers(1, 40))
def test_kept_blocks_are_few_multiples_of_the_block_length_and_lose_nothing(shots, size):
    costs = np.random.default_rng(shots).random(shots)
    blocks = in_blocks(costs, size)
    assert len(blocks) <= BLOCKS
    assert blocks.sum() == pytest.approx(costs.sum())


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


def test_another_constant_changes_the_decision_and_is_set_back(results: Path):
    table, kept = pl.read_parquet(results), confidence.NEAR
    settings = {"confidence.NEAR": 0.1, "confidence.CLEAN": 0.0}
    again = rescore.rescored(table, settings)[0]
    assert again.named[0].confidence <= 0.1
    assert kept == confidence.NEAR


def test_an_unknown_constant_and_an_unknown_list_are_refused_in_a_line():
    with pytest.raises(SystemExit, match=r"not a constant of a kept decision"):
        rescore.parsed(["confidence.NOPE=1"])
    with pytest.raises(SystemExit, match="no number"):
        rescore.parsed(["confidence.NEAR=much"])
    with pytest.raises(SystemExit, match="give NAME"):
        command.sizes(["clean-four"])
