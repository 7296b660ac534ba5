"""Formulas in reports: every number beside its term, and nothing of what is not there."""

from __future__ import annotations

from hydro.core.diagnosis.findings import inline
from hydro.report import ladder, words

TABLE = {
    "forces": ["Z u q"],
    "moments": ["N |v|^n sgn(v)"],
    "force": [90.1],
    "moment": [33.2],
    "exponents": [2.47],
}
ERRORS = {"force": [0.5], "moment": [0.1], "exponents": [0.01]}


def test_numbers_of_a_formula_are_listed_with_their_terms():
    found = words.values("formula", inline(TABLE), inline(ERRORS))
    assert [(one.name, one.value, one.error, one.unit) for one in found] == [
        ("Z u q", 90.1, 0.5, "N"),
        ("N |v|^n sgn(v)", 33.2, 0.1, "N m"),
        ("exponents 1", 2.47, 0.01, ""),
    ]


def test_the_lines_of_a_step_say_which_term_has_which_coefficient():
    lines = list(ladder.values({"name": "formula", **TABLE, "standard_error": ERRORS}))
    assert lines == [
        "force: Z u q 90.1 ± 0.5 [N]",
        "moment: N |v|^n sgn(v) 33.2 ± 0.1 [N m]",
        "exponents: 2.47 ± 0.01",
    ]


def test_parts_that_a_formula_lacks_have_no_line():
    alone = {"name": "formula", "forces": [], "force": [], "moments": ["K"], "moment": [2.0], "exponents": []}
    errors = {"force": [], "moment": [0.1], "exponents": []}
    assert list(ladder.values(alone | {"standard_error": errors})) == ["moment: K 2.0 ± 0.1 [N m]"]


def test_a_list_of_values_near_0_is_called_near_0():
    table = {"name": "offset_drag", "drag": [300.0, 0.1, 0.1], "position": [0.01, 0.0, 0.0]}
    errors = {"standard_error": {"drag": [3.0, 1.0, 1.0], "position": [0.1, 0.1, 0.1]}}
    assert list(ladder.values(table | errors)) == [
        "drag: no. 1: 300 ± 3, all others near 0 [N s^2/m^2]",
        "position: all near 0 [m]",
    ]


def test_an_undetermined_entry_is_not_called_near_0():
    errors = {"standard_error": {"g": [0.06, 0.06, 1.5, 1.5]}}
    assert list(ladder.values({"name": "thruster_gain", "g": [-0.85, 0.01, -0.82, -0.26]} | errors)) == [
        "g: no. 1: -0.85 ± 0.06, not determined: no. 3, 4, all others near 0",
    ]
