"""Kept tables of the diagnosis beside its rivals, from results of the scoreboard."""

from __future__ import annotations

import polars as pl
import pytest

from benchmarks import imperfect_tables
from benchmarks.judge import rows
from benchmarks.judge.scores import score

STUDY = dict.fromkeys(rows.SCHEMA) | {"role": "finding", "failure": "", "alias": [], "misjudged": []}
STUDY |= {"seconds": 160.0, "share": 0.4, "cpu": 20.0, "study_cpu": 30.0, "chi2_end": 20.0}
STUDY |= {"before": 1.0, "after": 0.5, "with_truth": 0.4}


def study(seed, name, verdict, effect="", sure=None, called=("payload",), **more):
    """The score of a study with one finding."""
    row = STUDY | {"seed": seed, "list": name, "called": list(called), "title": " + ".join(called)}
    row |= {"verdict": verdict, "effect": effect, "members": [effect] if effect else [], "confidence": sure}
    return score([row | more])


def test_the_file_as_given_is_the_baseline():
    studies = [
        study(1, "panel-plain", "missing", "payload", 1.0),
        study(2, "panel-plain", "suspect", "tether", 0.5, after=2.0),
        study(3, "panel-plain", "nothing_missing", share=0.05),
        study(1, "unchanged-plain", "nothing_missing", called=(), chi2_end=2.0),
    ]
    kinds = {"rival": "regression", "condition": "imperfect base", "failure": "", "share": 1.0, "cpu": 1.0}
    named = {"misjudged": [], "called": ["tether"], "before": 1.0}
    rivals = pl.DataFrame(
        [
            kinds | named | {"kind": "one", "named": "tether", "after": 0.5},
            kinds | named | {"kind": "none", "named": "payload", "after": 3.0, "called": []},
        ]
    )
    ours, theirs, best, given = imperfect_tables.base(studies, rivals)
    assert ours["named first"].endswith("(1 of 2)"), "a change that makes less than a tenth is left out"
    assert ours["stated, of all"].endswith("(1 of 2)")
    assert ours["stated wrongly"].endswith("(0 of 3)")
    assert ours["`nothing_missing` above 3"].endswith("(1 of 4)")
    assert ours["error after / before"].startswith("1.25, greater in 50.0 %")
    assert ours["studies"] == "2 + 1, 1 stated"
    assert theirs["named first"].endswith("(1 of 1)")
    assert theirs["alarm, nothing hidden"].endswith("(1 of 1)")
    assert best["error after / before"].startswith("0.40")
    assert given["error after / before"] == "1.00"
    assert given["nothing named"].endswith("(2 of 2)")


def test_a_current_of_the_condition_is_no_alarm_where_nothing_else_is_hidden():
    where = {"condition": "way-points in a current", "title": ""}
    studies = [
        study(1, "logs-none", "missing", "ocean_current", 1.0, called=("ocean_current",), **where),
        study(2, "logs-none", "missing", "tether", 1.0, called=("ocean_current",), **where),
        study(3, "logs", "cannot_tell_apart", "tether", 0.5, members=["payload"], condition="filtered"),
    ]
    cells = {row["log"]: row for row in imperfect_tables.logs(studies, pl.DataFrame(schema=RIVALS))}
    assert cells["way-points in a current"]["alarm, nothing hidden"].endswith("(1 of 2)")
    assert cells["controllers, all together"]["studies"] == "0 + 2, 2 stated"
    assert cells["filtered"]["in a tie"].endswith("(1 of 1)")
    assert cells["filtered"]["named first"].endswith("(0 of 1)")


RIVALS = imperfect_tables.SCHEMA


@pytest.mark.parametrize("which", ["base", "logs"])
def test_a_kept_table_tells_the_command_that_made_it(which, tmp_path, monkeypatch):
    lists = {
        "base": ["panel-before", "panel-before", "unchanged-before"],
        "logs": ["logs", "logs", "logs-none"],
    }
    table = pl.DataFrame(
        [
            STUDY
            | {"list": name, "seed": 200_000 + number % 2, "verdict": "nothing_missing", "called": []}
            | {"title": "payload" if number < 2 else "", "condition": "filtered", "effect": ""}
            for number, name in enumerate(lists[which])
        ],
        schema=rows.SCHEMA,
    )
    table.write_parquet(tmp_path / "results.parquet")
    kept = {}
    monkeypatch.setattr(imperfect_tables, "keep", lambda name, rows: kept.update({name: rows}))
    monkeypatch.setattr("sys.argv", ["x", which, str(tmp_path / "results.parquet"), "--commit", "1234567"])
    imperfect_tables.main()
    commands = {row["command"] for row in kept[f"imperfect_{which}"]}
    first, second = lists[which][1:]
    assert commands == {
        f"python -m benchmarks.judge run --list {first}=2 --list {second}=1 --first-seed 200000"
        + (" --seconds 160" if which == "base" else "")
    }
