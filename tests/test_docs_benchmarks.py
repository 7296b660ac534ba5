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


def shown(beginning: str) -> list[str]:
    """Return the cells of the one row of README's results that begins so, links without their targets."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", (ROOT / "README.md").read_text())
    (row,) = [line for line in text.splitlines() if line.startswith(f"| {beginning}")]
    return [part.strip() for part in row.strip("|").split("|")]


def counts(text: str) -> tuple[int, int]:
    """Return both numbers of the last "N of M" in a cell."""
    hit, trials = re.findall(r"(\d+) of (\d+)", text)[-1]
    return int(hit), int(trials)


def total(column: str, *names: str) -> str:
    """Return "N of M", summed over the rows of imperfect_base with these names."""
    rows = {row["by"]: row for row in GENERATOR["results"]("imperfect_base")}
    pairs = [counts(rows[name][column]) for name in names]
    return f"{sum(hit for hit, _ in pairs)} of {sum(trials for _, trials in pairs)}"


def with_share(text: str) -> str:
    """Return "N of M (P %)" for "N of M"."""
    hit, trials = counts(text)
    return f"{text} ({100 * hit / trials:.0f} %)"


def test_the_readme_quotes_hidden_effects() -> None:
    exactly = [
        cell("hidden_effects", "shown", hidden=f"{number} effect").split(",")[0]
        for number in ("one", "two", "three")
    ]
    _, _, result, reference = shown("own simulator and a second one")
    names = ("one", "two", "three")
    assert result.split("; ")[0] == ", ".join(
        f"{name}: {count}" for name, count in zip(names, exactly, strict=True)
    )
    oracle = cell("hidden_effects", "shown", hidden="held-out error").split("median ratio ")[1]
    assert result.split("; ")[1] == f"median held-out error {oracle} times that of the true model"
    assert reference == "true model: 1"


def test_the_readme_quotes_the_challenge() -> None:
    rows = {row["entry"]: row for row in GENERATOR["results"]("challenge")}
    said = {
        name: "; ".join(
            "{} of {}".format(*counts(rows[name][column])) for column in ("named first", "false alarms")
        )
        for name in ("hydro", "PySINDy")
    }
    _, _, result, baseline = shown("sealed cases of three simulators")
    assert (result, baseline) == (said["hydro"], f"PySINDy: {said['PySINDy']}")


def test_the_readme_quotes_imperfect_hulls() -> None:
    plain = ("`hydro diagnose`", "`hydro diagnose`, other seeds")
    _, _, result, baseline = shown("simulated hulls that no formula fits exactly")
    assert result == with_share(total("named first", *plain))
    bic = with_share(total("named first", "regression with BIC")).replace("of", "of the first")
    assert baseline == f"regression, terms chosen by BIC: {bic}"
    before = tuple(f"`hydro diagnose --before`, 720 s, {which}" for which in ("latest code", "other seeds"))
    assert shown("the same, with 12 minutes")[2] == total("named first", *before)
    wrong = total("stated wrongly", *before).split(" of ")[0]
    changes = total("named first", *before).split(" of ")[1]
    assert shown("both tests with a recording from before")[2].split(", ")[0] == f"{wrong} of {changes}"
    alarms, studies = re.findall(r"\d+", cell("hidden_effects", "shown", hidden="nothing"))[:2]
    nothing = tuple(f"the same, nothing changed, {which}" for which in ("latest code", "other seeds"))
    column = "alarm, nothing hidden"
    _, _, result, baseline = shown("the same simulators, nothing hidden")
    assert result == (
        f"exact formulas: {alarms} of {studies}; hulls: {total(column, plain[0])}; "
        f"hulls with 12 minutes from before: {total(column, *nothing)}"
    )
    assert baseline == f"regression on the hulls: {total(column, 'regression with BIC')}"


def test_the_readme_quotes_the_simulator_apart() -> None:
    answers = {row["answer"]: counts(row["cases"]) for row in GENERATOR["results"]("apart")}
    right, cases = answers["right"]
    wrong, _ = answers["wrong, stated at 0.9 or more"]
    commonest, _ = answers["the commonest change named of each (baseline)"]
    _, test, result, baseline = shown("independent simulator")
    assert test == f"name the change in {cases} cases"
    assert result == f"{right} right"
    assert shown("both tests with a recording from before")[2].split(", ")[1] == f"{wrong} of {cases}"
    assert baseline == f"the commonest change, named each time: {commonest}"


def test_the_readme_quotes_stonefish() -> None:
    error = {row["added"]: row["held out, m/s"] for row in GENERATOR["results"]("stonefish")}
    squares = cell("stonefish", "held out, m/s", added="nothing (baselines: least squares")
    _, _, result, baseline = shown("outside simulator Stonefish")
    assert result.startswith(f"{error['offset_drag']} m/s with three effects added,")
    assert list(error).index("offset_drag") - list(error).index("the file as given") == 3
    assert baseline == f"as given: {error['the file as given']} m/s; least squares: {squares} m/s"
    ours = cell("networks_replay", "u", replay="MJ4 (PhysicsFeature-MLP), from the bundled sample")
    mujoco = cell("networks_replay", "u", replay="MJ0+ellipsoid")
    assert shown("Stonefish, network")[2:] == [f"{ours} m/s", f"MuJoCo's fluid model: {mujoco} m/s"]


def test_the_readme_quotes_sensors_and_imports() -> None:
    few = cell("subsets", "of these within 3 s.e.", samples_of="attitude and depth")
    complete = cell("subsets", "of these within 3 s.e.", samples_of="complete")
    assert few.split(" of ")[1] == cell("subsets", "numbers determined", samples_of="attitude").split()[2]
    assert shown("own simulator, 150 s")[2:] == [f"{few} values", f"complete log: {complete}"]
    vehicles = ("bluerov2_heavy", "remus100", "auv151")
    answers = {
        row["mistake"]: [row[name] for name in vehicles] for row in GENERATOR["results"]("planted_mistakes")
    }
    silent = answers.pop("none")
    named = [answer for row in answers.values() for answer in row]
    assert shown("own simulator, one mistake")[2:] == [
        f"{named.count('named')} of {len(named)}",
        f"correct logs: 0 warnings in {silent.count('0 warnings')} vehicles",
    ]


def test_the_readme_quotes_policies() -> None:
    rows = [row for row in GENERATOR["results"]("paper_rl") if "continued" not in row["condition"]]
    ended = [row for row in rows if row["result"].startswith(("budget used", "passed"))]
    planned = sum(len(row["seed"].split(",")) for row in rows)
    assert len(ended) == planned
    assert f"and {planned} by SAC, in six models of the water," in README
    assert len({row["condition"] for row in rows}) == 6
    (_,) = [row for row in ended if row["divergence"] != "none"]
    assert "steps; one diverged." in README
    first, second, third = (sum(bool(row[f"stage {k} passed after"]) for row in ended) for k in (1, 2, 3))
    assert f"Of the {planned}, {first} passed stage 1 (open water), {second} of them stage 2" in README
    assert f"and {third} of these stage 3 (forest), within {ended[0]['steps']} steps;" in README
    study = [counts(row["passed all three"])[1] for row in GENERATOR["results"]("rl_study_trainings")]
    trainings = len(GENERATOR["results"]("rl_trainings")) + sum(study)
    assert f"{trainings} trainings by imitation ([tables](docs/rl-figures.md))" in README
