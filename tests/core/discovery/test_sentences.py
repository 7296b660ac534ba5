"""Discovered terms in words: what grows with what, and where a force acts."""

from __future__ import annotations

import numpy as np
import pytest
from bench import BARE, equipped

from hydro.core.discovery.sentences import told
from hydro.core.discovery.terms import library
from hydro.core.effects import assemble, validate
from hydro.core.effects.formula import amounts, joined, one_term


def words(*terms):
    table = joined([one_term(*term) for term in terms])
    errors = {"force": [0.1] * len(table["force"]), "moment": [0.1] * len(table["moment"])}
    return told(table, errors | {"exponents": [0.05] * len(table["exponents"])})


@pytest.mark.parametrize(
    ("term", "said"),
    [
        (("Y |v|^n sgn(v)", -30.0, [2.4]), "drag in sway grows as |v|^2.40 +- 0.05"),
        (("Y |v|^n sgn(v)", 30.0, [2.4]), "a force along the motion in sway grows as |v|^2.40 +- 0.05"),
        (("M |u|^n sgn(u)", 3.0, [1.5]),
         "surge causes a moment in pitch that grows as |u|^1.50 +- 0.05 and changes sign with it"),
        (("M |u|^n", 3.0, [1.5]), "a moment in pitch is proportional to |u|^1.50 +- 0.05"),
        (("Y |r|^n v", -3.0, [0.8]), "yaw raises the drag in sway, as |r|^0.80 +- 0.05 v"),
        (("Z u q", 3.0), "a force in heave is proportional to u q"),
        (("N c2", 3.0), "command c2 causes a moment in yaw"),
        (("N |u|^n c2", 3.0, [2.0]), "command c2 causes a moment in yaw that grows as |u|^2.00 +- 0.05"),
        (("Y |c2|^n sgn(c2)", 3.0, [2.0]),
         "command c2 causes a force in sway that grows as |c2|^2.00 +- 0.05 and changes sign with it"),
        (("K", 3.0), "a steady moment in roll"),
        (("K g_y", 3.0), "a moment in roll depends on roll"),
    ],
)  # fmt: skip
def test_a_term_in_words(term, said):
    assert words(term) == said


@pytest.mark.parametrize(
    ("force", "moment", "point", "said"),
    [
        ("Y", "N", (0.2, 0.0, 0.0), "0.20 m ahead of"),
        ("Y", "N", (-0.3, 0.0, 0.0), "0.30 m aft of"),
        ("Z", "M", (0.2, 0.0, 0.0), "0.20 m ahead of"),
        ("Y", "K", (0.0, 0.0, 0.1), "0.10 m below"),
        ("X", "M", (0.0, 0.0, -0.1), "0.10 m above"),
    ],
)
def test_a_force_and_its_moment_act_where_the_lever_says(force, moment, point, said):
    """The moment is r x F of a force that opposes the motion, by numpy's cross product."""
    axis = "XYZ".index(force)
    speed = "uvw"[axis]
    pull = -40.0 * np.eye(3)[axis]
    turned = float(np.cross(point, pull)["KMN".index(moment)])
    law = f"|{speed}|^n sgn({speed})"
    assert said in words((f"{force} {law}", -40.0, [2.1]), (f"{moment} {law}", turned, [2.05]))


def test_laws_of_different_powers_do_not_act_at_a_point():
    both = words(("Y |v|^n sgn(v)", -40.0, [2.5]), ("N |v|^n sgn(v)", -4.0, [1.2]))
    assert "acts" not in both
    assert both.count(";") == 1


def test_every_term_of_the_library_can_be_flown_and_stands_there_once():
    terms = library(2)
    assert len({(term.text, term.powers) for term in terms}) == len(terms)
    for term in terms:
        vehicle = equipped(term.table(1.0))
        validate(vehicle)
        assert assemble(vehicle).effects == ("formula",)
    whole = joined([term.table(float(number)) for number, term in enumerate(terms)])
    assert sorted(value for _, value, _ in amounts(whole)) == list(map(float, range(len(terms))))
    assert {term.text[0] for term in terms} == set("XYZKMN")
    assert BARE.effect == ()
