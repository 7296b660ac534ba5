"""Figures stand once: the page of benchmarks is made from the result tables, and the README quotes them."""

from __future__ import annotations

import re
import runpy
from collections.abc import Iterator
from datetime import date
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
RESULTS = sorted((ROOT / "benchmarks" / "results").glob("*.csv"))
README = " ".join((ROOT / "README.md").read_text().split())
GENERATOR = runpy.run_path(str(ROOT / "docs" / "generate_benchmarks.py"))
PAGES = {name: (ROOT / "docs" / f"{name}.md").read_text() for name in GENERATOR["PAGES"]}


def cell(table: str, column: str, **where: str) -> str:
    """The one cell of a result table in a row where columns (`_` for a blank) begin as told."""
    (found,) = [
        row[column]
        for row in GENERATOR["results"](table)
        if all(row[key.replace("_", " ")].startswith(value) for key, value in where.items())
    ]
    return found


@pytest.mark.parametrize("name", PAGES)
def test_the_page_is_current(name: str) -> None:
    assert GENERATOR["page"](name) == PAGES[name], "run `make docs`"
    assert len(PAGES[name].splitlines()) <= 200
    assert "{{" not in PAGES[name]


def test_what_waits_for_a_table_is_left_out_until_it_is_kept() -> None:
    said = "before\n{{with:recovery}}\nkept\n{{end}}\n{{with:of_nothing}}\nnot kept\n{{end}}\nafter\n"
    assert GENERATOR["measured"](said) == "before\nkept\nafter\n"


def test_every_result_table_is_shown_once() -> None:
    shown = re.findall(r"\]\(\.\./benchmarks/results/(\w+\.csv)\)", "".join(PAGES.values()))
    assert sorted(shown) == sorted(path.name for path in RESULTS)


def faults(row: dict[str | None, str]) -> Iterator[str]:
    """Yield what a row of a result table fails to say of its origin."""
    if None in row:
        yield "more cells than columns"
    if not set(GENERATOR["ORIGIN"]) < set(row):
        yield "not all columns of an origin"
        return
    if not date(2026, 11, 1) <= date.fromisoformat(row["date"]) <= date.today():
        yield f"made on {row['date']}"
    if not row["command"]:
        yield "no command"
    for commit in (row["commit"], row["recorded"]):
        if not re.fullmatch(r"[0-9a-f]{7,40}|", commit):
            yield f"no commit: {commit}"


def test_figures_say_where_they_come_from() -> None:
    rows = [(path.stem, GENERATOR["results"](path.stem)) for path in RESULTS]
    assert [name for name, each in rows if not each] == []
    assert [f"{name}: {fault}" for name, each in rows for row in each for fault in faults(row)] == []


def test_a_row_without_its_origin_is_seen() -> None:
    row = GENERATOR["results"]("hidden_effects")[0]
    assert list(faults(row)) == []
    for name, value in (("date", "2020-01-01"), ("command", ""), ("commit", "main"), ("recorded", "x")):
        assert len(list(faults(row | {name: value}))) == 1, name
    assert list(faults({name: value for name, value in row.items() if name != "date"})) != []
    assert list(faults(row | {None: "x"})) != []


def test_the_readme_quotes_the_result_tables() -> None:
    one = cell("hidden_effects", "shown", hidden="one effect")
    two = cell("hidden_effects", "shown", hidden="two effects of at least")
    alarms, studies = re.findall(r"\d+", cell("hidden_effects", "shown", hidden="nothing"))[:2]
    assert alarms == "0"
    three = cell("hidden_effects", "shown", hidden="three effects")
    assert f"right in {one.split(',')[0]} studies, two at once exactly in {two.split(',')[0]}" in README
    assert f"three in {three.split(',')[0]}" in README
    assert f"false alarm in {studies}" in README
    slalom, planned = "8 pillars, no plan", "8 pillars, planned way"
    teacher = {
        name: cell("rl_pillars", slalom, flown_by=name, in_the="teacher").split("%")[0] + " %"
        for name in ("R_0", "R_effects, as given", "R_effects, identified", "R_PhysFeat")
    }
    assert re.search(
        rf"without water forces {teacher['R_0']} arrive, .* numbers {teacher['R_effects, as given']}, "
        rf".* data {teacher['R_effects, identified']}, .* data {teacher['R_PhysFeat']} ",
        README,
    )
    pilot = cell("rl_pillars", planned, flown_by="pilot", in_the="teacher")
    best = max(
        float(row[planned].split("%")[0])
        for row in GENERATOR["results"]("rl_pillars")
        if row["in the"] == "teacher" and "%" in row[planned] and "pilot" not in row["flown by"]
    )
    assert f"that pilot arrives in {pilot.split('%')[0]} % of the tasks in the teacher" in README
    assert f"({best:g} % at best)" in README
    without = cell("rl_pillars", slalom, flown_by="pilot", in_the="teacher").split("%")[0]
    assert f"by hand arrives in {without} % without a plan" in README
    medians = [
        float(row["in the teacher"].split("%")[0])
        for row in GENERATOR["results"]("rl_study")
        if row["task"].startswith("forest") and row["flown by"].startswith("policies")
    ]
    assert len(medians) == 6
    assert f"in {min(medians):g} to {max(medians):g} % of a forest" in README
