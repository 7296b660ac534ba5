"""Formulas of a vehicle file: what they say is what acts, by numpy, built-in effects and a closed form."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest
from bench import equipped, neutral, wrench
from hypothesis import given
from hypothesis import strategies as st
from strategies import states, vectors, velocities

from hydro.core.columns import POSE, VELOCITY, Array, command_columns
from hydro.core.effects import CATALOGUE, assemble, validate
from hydro.core.effects.formula import AXES, NAMES, amounts, joined, one_term, parsed
from hydro.core.effects.layout import MOST_COMMANDS
from hydro.core.errors import DataError
from hydro.core.identification.fit import fit
from hydro.core.simulation.simulate import trajectory
from hydro.core.vehicle.description import Thruster, Vehicle
from hydro.io import vehicle as files

SEEN = NAMES[: -MOST_COMMANDS + 2]
"""Names that mean something on a vehicle of two thrusters."""
LEVEL = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
PLAIN = {"name": "formula", "forces": ["X |u| u"], "force": [-1.0]}


def idle() -> Vehicle:
    """A neutral vehicle whose only thruster makes next to no thrust."""
    still = Thruster("idle", 1e-9, 1e-9, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    return msgspec.structs.replace(neutral(), thruster=(still,))


def recorded(t: Array, motion: Array, commands: Array) -> pl.DataFrame:
    """A raw table of one session."""
    names = (*POSE, *VELOCITY, *command_columns(commands.shape[1]))
    values = dict(zip(names, np.hstack([motion, commands]).T, strict=True))
    return pl.DataFrame({"session": ["one"] * len(t), "t": t} | values)


@pytest.mark.parametrize(
    ("term", "right"),
    [
        ("X |u|^1.5 u", True),
        ("X u^3", True),
        ("X u^1.5", False),  # of no sign where u is below 0
        ("X |u|^4.1", False),
        ("X u^5", False),
        ("X |u|^-1", False),
    ],
)
def test_a_power_lies_within_bounds_and_is_whole_where_the_sign_counts(term: str, right: bool):
    if right:
        assert parsed(term)[0][0] == AXES.index("X")
    else:
        with pytest.raises(DataError, match="the power of"):
            parsed(term)


@st.composite
def terms(draw):
    """A term as text, and the same as a function of what its names stand for."""
    names = draw(st.lists(st.sampled_from(SEEN), max_size=3))
    text, functions = [draw(st.sampled_from(AXES))], []
    for name in names:
        kind = draw(st.sampled_from(("plain", "size", "sign")))
        power = draw(st.integers(1, 3)) if kind == "plain" else draw(st.sampled_from((0.5, 1.0, 1.7, 2.0)))
        text.append({"plain": f"{name}^{power}", "size": f"|{name}|^{power:g}", "sign": f"sgn({name})"}[kind])
        functions.append(
            {
                "plain": lambda x, n=name, a=power: x[n] ** a,
                "size": lambda x, n=name, a=power: abs(x[n]) ** a,
                "sign": lambda x, n=name: np.sign(x[n]),
            }[kind]
        )
    return " ".join(text), lambda x: float(np.prod([1.0, *(f(x) for f in functions)]))


@given(states(), vectors(2, 1.0), st.lists(terms(), min_size=1, max_size=5), vectors(5, 30.0))
def test_a_formula_is_what_its_terms_say(state, commands, given_terms, amounts):
    eta, nu = state
    phi, theta = eta[3], eta[4]
    down = (-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi))
    known = dict(zip(SEEN, (*nu, *down, eta[2], *commands), strict=True))
    expected = np.zeros(6)
    for (text, value), amount in zip(given_terms, amounts, strict=False):
        expected[AXES.index(text[0])] += amount * value(known)
    every = [one_term(text, float(amount)) for (text, _), amount in zip(given_terms, amounts, strict=False)]
    np.testing.assert_allclose(
        wrench(joined(every), eta, nu, commands=commands), expected, rtol=1e-9, atol=1e-9
    )


@given(velocities(), vectors(6, 50.0), st.floats(0.3, 3.0))
def test_a_free_power_is_an_exponent_of_its_own(nu, sizes, power):
    every = [
        one_term(f"{AXES[i]} |{'uvwpqr'[i]}|^n sgn({'uvwpqr'[i]})", -float(sizes[i]), [power])
        for i in range(6)
    ]
    expected = -sizes * np.abs(nu) ** power * np.sign(nu)
    np.testing.assert_allclose(wrench(joined(every), LEVEL, nu), expected, rtol=1e-9, atol=1e-9)


@given(velocities(), vectors(6, 50.0))
def test_a_formula_of_quadratic_damping_is_quadratic_damping(nu, sizes):
    every = [one_term(f"{AXES[i]} |{'uvwpqr'[i]}| {'uvwpqr'[i]}", -float(sizes[i])) for i in range(6)]
    built_in = wrench({"name": "quadratic_damping", "diagonal": sizes.tolist()}, LEVEL, nu)
    np.testing.assert_allclose(wrench(joined(every), LEVEL, nu), built_in, rtol=1e-12, atol=1e-12)


def test_drag_with_the_power_three_halves_slows_a_coasting_vehicle_as_a_square():
    """m u' = -d u^1.5 has 1/sqrt(u) = 1/sqrt(u_0) + d t / (2 m)."""
    vehicle = equipped(one_term("X |u|^n sgn(u)", -8.0, [1.5]), bare=neutral())
    t = np.arange(500) * 0.02
    u = trajectory(assemble(vehicle), np.zeros((500, 1)), t, nu=[2.0, 0, 0, 0, 0, 0])[:, 6]
    np.testing.assert_allclose(u, (1.0 / np.sqrt(2.0) + 8.0 * t / 100.0) ** -2, rtol=1e-8)


def test_a_term_of_a_command_acts_from_its_row_to_the_next():
    """m u' = a c_k on [t_k, t_k+1): the velocity is the sum of the commands before."""
    vehicle = equipped(one_term("X c1", 30.0), bare=idle())
    t, commands = np.arange(80) * 0.02, np.sign(np.sin(np.arange(80.0)))[:, None]
    u = trajectory(assemble(vehicle), commands, t, nu=np.zeros(6))[:, 6]
    gained = 30.0 / 50.0 * 0.02 * commands[:-1, 0]
    np.testing.assert_allclose(u, np.concatenate([[0.0], np.cumsum(gained)]), atol=1e-9)


@pytest.mark.parametrize("method", ["equation", "output"])
def test_a_term_of_a_command_is_fitted(method):
    """Whichever way: a row too early or late would miss a coefficient that is all of the force."""
    vehicle = equipped(one_term("Y c1 |c1|", 30.0), bare=idle())
    t = np.arange(3000) * 0.02
    commands = np.clip(np.repeat(np.random.default_rng(0).normal(0.0, 0.6, 300), 10), -1.0, 1.0)[:, None]
    motion = trajectory(assemble(vehicle), commands, t)
    raw = recorded(t, motion, commands)
    found = fit(equipped(one_term("Y c1 |c1|", 0.0), bare=idle()), raw, ["formula"], method=method)
    assert found.vehicle.effects("formula")[0]["force"][0] == pytest.approx(30.0, rel=1e-3)


def test_a_term_without_a_coefficient_has_none():
    table = {"name": "formula", "forces": ["X |u|^n sgn(u)"], "moments": ["N r"], "exponents": [1.5]}
    assert amounts(table) == [("X |u|^n sgn(u)", 0.0, (1.5,)), ("N r", 0.0, ())]


def test_joined_formulas_keep_each_exponent_with_its_term():
    tables = [
        one_term("N |r|^n sgn(r)", -1.0, [1.2]),
        one_term("X |u|^n |w|^n", -2.0, [1.3, 0.4]),
        one_term("Y |v|^n v", -3.0, [0.7]),
    ]
    whole = joined(tables)
    assert (whole["forces"], whole["moments"]) == (["X |u|^n |w|^n", "Y |v|^n v"], ["N |r|^n sgn(r)"])
    assert whole["exponents"] == [1.3, 0.4, 0.7, 1.2]
    nu = np.array([0.5, -0.4, 0.3, 0.2, -0.1, 0.6])
    apart = sum(wrench(table, LEVEL, nu) for table in tables)
    np.testing.assert_allclose(wrench(whole, LEVEL, nu), apart, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"forces": ["A |u| u"]}, "is no term"),
        ({"forces": ["X u v w p"]}, "is no term"),
        ({"forces": ["X |u|^9 u"]}, "up to 4"),
        ({"forces": ["X u^1.5"]}, "has another"),
        ({"forces": ["X |u|^nan u"]}, "a number or n"),
        ({"forces": ["X sgn(u)^2"]}, "is no factor"),
        ({"forces": ["X |speed| u"]}, "is no factor"),
        ({"forces": ["X __import__('os')"]}, "is no factor"),
        ({"forces": ["N |r| r"]}, "belongs to moments"),
        ({"forces": "X |u| u"}, "a list of terms"),
        ({"forces": []}, "needs terms"),
        ({"force": [-1.0, 2.0]}, "effect[0].force"),
        ({"forces": ["X |u|^n u"], "exponents": []}, "effect[0].exponents"),
        ({"forces": ["X |u|^n u"]}, "a number for each of the 1 powers"),
        ({"exponents": [1.0]}, "effect[0].exponents"),
        ({"forces": ["X c0 u"]}, "is no factor"),
        ({"forces": ["X c1", "X c3"], "force": [1.0, 2.0]}, "c3 is no thruster's command: the vehicle has 2"),
        ({"power": 2}, "no such parameter"),
    ],
)
def test_what_is_no_formula_is_refused_by_its_place(change, told):
    with pytest.raises(DataError, match=r"effect\[0\]") as refusal:
        validate(equipped({**PLAIN, **change}))
    assert told in str(refusal.value)


def test_a_formula_is_read_and_written_like_any_other(tmp_path, datasets):
    text = (datasets / "vehicles" / "auv151.toml").read_text()
    table = '\n[[effect]]\nname = "formula"\nforces = ["Y |v|^n v"]\nforce = [-12.5]\nexponents = [0.4]\n'
    path = tmp_path / "own.toml"
    path.write_text(text + table)
    vehicle, _ = files.read(path)
    assert vehicle.effects("formula")[0]["forces"] == ["Y |v|^n v"]


def test_the_example_of_the_catalogue_has_no_effect():
    example = {words.name: list(words.example) for words in CATALOGUE["formula"].words}
    table = {"name": "formula", **example, "force": [0.0], "moment": [0.0], "exponents": [1.0]}
    np.testing.assert_array_equal(wrench(table, LEVEL, np.ones(6)), np.zeros(6))
