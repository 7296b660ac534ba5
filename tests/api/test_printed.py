"""What a shell and a notebook show of a result: the headline, a short table, and nothing that breaks out."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import time
import tomllib
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import made_results as made
import polars as pl
import pytest
import tomlkit
from hypothesis import example, given
from hypothesis import strategies as st

import hydro
from hydro.api.printed import MOST_ROWS, WIDTH, html, text
from hydro.core.diagnosis.findings import Finding

ROOT = Path(hydro.__file__).parents[1]
KINDS = ("diagnosis", "comparison", "fit", "study")
TAGS = {"div", "p", "strong", "table", "thead", "tbody", "tr", "th", "td"}
HOSTILE = "<script>alert('x')</script> & \"y\" \x1b[31m\n</table>"
NAMES = st.text(min_size=1, max_size=120)


@pytest.fixture(params=KINDS)
def result(request: pytest.FixtureRequest) -> Any:
    return made.every()[request.param]


def words(told: str) -> str:
    return " ".join(told.split())


def seen(root: ET.Element) -> str:
    return " ".join(root.itertext())


def test_the_headline_comes_first_and_the_table_below(result: Any) -> None:
    told = repr(result)
    assert words(told).startswith(words(result.headline))
    assert str(result) == told
    for name in result.summary().columns:
        there = result.summary()[name].drop_nulls().len() > 0
        assert (name.replace("_", " ") in told) == there


def test_lines_fit_a_shell(result: Any) -> None:
    assert max(map(len, repr(result).splitlines())) <= WIDTH
    assert len(repr(result).splitlines()) <= 24


def test_html_is_well_formed_and_says_the_same(result: Any) -> None:
    root = ET.fromstring(result._repr_html_())
    assert {one.tag for one in root.iter()} <= TAGS
    assert root.findtext("p/strong") == result.headline
    rows = root.findall("table/tbody/tr")
    assert len(rows) == result.summary().height
    heads = [one.text for one in root.findall("table/thead/tr/th")]
    assert {len(row) for row in rows} == {len(heads)}


def test_units_stand_behind_names_of_columns() -> None:
    told = repr(made.diagnosis())
    assert "error added [m/s]" in told
    assert "Not visible in this recording: surface_suction." in told
    assert "Look up an effect: hydro effects ocean_current" in told
    assert "need not sum to 100 %" in told
    errors = "0.121 m/s as given, 0.0500 m/s on held-out data with the findings added, noise floor 0.016 m/s."
    assert f"Error 5 s ahead: {errors}" in words(told)
    assert "Next: add this correction to the vehicle file, `hydro.add(vehicle, found)`." in words(told)
    assert "Errors of predictions, 5 s ahead:" in repr(made.comparison())


def test_findings_that_do_not_lower_the_error_are_called_so() -> None:
    worse = replace(made.PREDICTION, added=0.12, spread=0.01, floor=None)
    told = words(repr(made.diagnosis(prediction=worse)))
    assert "0.120 m/s on held-out data with the findings added. The findings do not lower it" in told
    same = replace(worse, added=worse.given)
    assert "Error 5 s ahead: 0.121 m/s as given." in words(repr(made.diagnosis(prediction=same)))


def test_a_step_is_one_line() -> None:
    first, last = made.study()
    assert (
        repr(first)
        == "Step 0, as given: error 5 s ahead 2.00 m/s on the recording, 1.80 m/s on held-out data."
    )
    assert last.headline.startswith("Step 1, ocean current: error 5 s ahead 0.200 m/s on the recording")


def test_a_result_is_printed_cheaply(result: Any) -> None:
    repr(result)
    begun = time.process_time()
    for _ in range(5):
        repr(result), result._repr_html_()
    assert time.process_time() - begun < 1.0


@given(name=NAMES)
@example(name=HOSTILE)
def test_names_from_a_file_cannot_inject_html_or_commands(name: str) -> None:
    warned, placed = made.fit((name,)), made.comparison(name)
    found = made.diagnosis(
        (Finding("log_fault", "", (name,), advice=name), Finding("not_excited", name, (name,)))
    )
    for one in (warned, placed, found):
        root = ET.fromstring(one._repr_html_())
        assert {each.tag for each in root.iter()} <= TAGS
        assert all(set(each.attrib) <= {"style"} for each in root.iter())
        assert all(sign.isprintable() or sign == "\n" for sign in repr(one))
    if name.isprintable():
        assert all(name in seen(ET.fromstring(one._repr_html_())) for one in (warned, found))


@given(cells=st.lists(st.text(max_size=200), min_size=1, max_size=20), units=NAMES, column=NAMES)
def test_any_table_fits_and_escapes(cells: list[str], units: str, column: str) -> None:
    table = pl.DataFrame({column: cells, "number": [1.5] * len(cells)})
    told = text(["Said."], table, ["Done."], {column: units} if len(column + units) < 20 else {})
    assert told.startswith("Said.\n")
    assert told.endswith("\nDone.")
    root = ET.fromstring(html(["Said."], table, ["Done."], {column: units}))
    assert {one.tag for one in root.iter()} <= TAGS
    assert len(root.findall("table/tbody/tr")) == min(len(cells), MOST_ROWS)
    assert (f"... and {len(cells) - MOST_ROWS} more" in told) == (len(cells) > MOST_ROWS)


def test_a_table_without_rows_or_values_is_not_printed() -> None:
    assert text(["Said."], pl.DataFrame({"a": [None], "b": [""]}), (), {}) == "Said."
    assert "<table>" not in html(["Said."], pl.DataFrame({"a": []}), (), {})
    shown = text(["Said."], pl.DataFrame({"a": [True, False], "b": [None, 2.0]}), (), {})
    assert shown.splitlines()[2:] == ["a       b", "yes     -", "no   2.00"]


def test_a_plain_shell_without_a_terminal_prints_draws_and_unpickles(tmp_path: Path) -> None:
    (tmp_path / "results.pickle").write_bytes(pickle.dumps(made.every()))
    script = """
import pickle
results = pickle.load(open("results.pickle", "rb"))
for name, result in results.items():
    print(result)
    print(result.headline)
    result.to_json(), result._repr_html_(), result.summary()
    result.plot()[0].figure.savefig(f"{name}.png")
"""
    keep = ("PATH", "PYTHONPATH", "HOME", "SYSTEMROOT", "LD_LIBRARY_PATH")
    bare = {name: os.environ[name] for name in keep if name in os.environ} | {"PYTHONUTF8": "1"}
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        env=bare,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert words(made.study().headline) in words(done.stdout)
    assert "\x1b" not in done.stdout
    assert all((tmp_path / f"{name}.png").stat().st_size > 5000 for name in made.every())


@pytest.mark.slow
def test_types_are_known_to_a_strict_checker(tmp_path: Path) -> None:
    pytest.importorskip("mypy", reason="mypy is not installed: `make install`")
    (tmp_path / "theirs.py").write_text(
        "import hydro\n"
        "import polars as pl\n"
        "def use(vehicle: hydro.Vehicle, raw: pl.DataFrame) -> hydro.Vehicle:\n"
        "    found = hydro.diagnose(vehicle, raw)\n"
        "    reveal_type(found)\n"
        "    reveal_type(found.headline)\n"
        "    reveal_type(found.table)\n"
        "    reveal_type(found.filter(pl.col('rank') == 1))\n"
        "    reveal_type(hydro.compare(vehicle, raw, against=hydro.compare(vehicle, raw)).summary())\n"
        "    reveal_type(hydro.fit(vehicle, raw, ['tether']).vehicle)\n"
        "    study = hydro.explain(vehicle, raw, on_step=print)\n"
        "    reveal_type(study)\n"
        "    reveal_type([step.number for step in study])\n"
        "    reveal_type(study[0].diagnosis)\n"
        "    hydro.write(found, 'diagnosis.parquet', 'diagnosis')\n"
        "    return hydro.add(study.vehicle, found)\n"
        "try:\n"
        "    hydro.vehicle('vehicle.toml')\n"
        "except hydro.DataError as error:\n"
        "    reveal_type(error.exit_code)\n"
    )
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]
    theirs = {"module": "theirs", "strict": True}
    mypy = {"python_version": project["python_version"], "overrides": [*project["overrides"], theirs]}
    (tmp_path / "pyproject.toml").write_text(tomlkit.dumps({"tool": {"mypy": mypy}}))
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file", tmp_path / "pyproject.toml", tmp_path / "theirs.py"],
        cwd=ROOT,  # with the project's options, so that what `make types` has analysed need not be again
        env=os.environ | {"MYPYPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    said = [line.split('"')[1] for line in done.stdout.splitlines() if "Revealed type" in line]
    revealed = [one.replace("builtins.", "") for one in said]
    assert revealed == [
        "hydro.api.diagnosis.Diagnosis",
        "str",
        "polars.dataframe.frame.DataFrame",
        "polars.dataframe.frame.DataFrame",
        "polars.dataframe.frame.DataFrame",
        "hydro.core.vehicle.description.Vehicle",
        "hydro.api.study.Study",
        "list[int]",
        "hydro.api.diagnosis.Diagnosis",
        "int",
    ]
