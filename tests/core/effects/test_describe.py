"""What is said of effects: the tables for a vehicle file are valid and, being zero, do nothing."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from bench import ADDED, BARE, DAMPED, equipped

from hydro.core.effects import CATALOGUE, Parameter, assemble, describe, validate, velocity_log
from hydro.core.simulation.simulate import trajectory


def tables(*names: str) -> list[dict]:
    return [tomllib.loads(describe.toml(CATALOGUE[name]))["effect"][0] for name in names]


def test_the_table_for_a_vehicle_file_is_valid_and_names_every_parameter():
    for table in tables(*CATALOGUE):
        validate(equipped(table))
    assert [
        f"{effect.name}.{parameter.name}"
        for effect in CATALOGUE.values()
        for parameter in effect.parameters
        if not all(word in describe.toml(effect) for word in (parameter.name, parameter.meaning))
    ] == []


def test_zero_is_absence():
    """A vehicle with all effects of the catalogue at 0 moves as one without."""
    commands = np.random.default_rng(0).uniform(-1, 1, (100, 2))
    start = {"eta": [1.0, 2.0, 3.0, 0.3, -0.2, 0.5], "nu": [0.4, -0.2, 0.1, 0.2, -0.1, 0.3]}
    moved = []
    for more in ((), tables(*CATALOGUE)):
        vehicle = equipped(ADDED, *DAMPED, *more, bare=BARE)
        assert not velocity_log(vehicle).any()
        moved.append(trajectory(assemble(vehicle), commands, np.arange(100) * 0.02, **start))
    np.testing.assert_allclose(moved[1], moved[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("parameter", "unit", "size", "bounds"),
    [
        (Parameter("a", ("N",), ""), "N", "1", "any"),
        (Parameter("a", ("N", "N m"), "", (6,), low=0.0), "N (X Y Z), N m (K M N)", "6", ">= 0"),
        (
            Parameter("a", ("kg", "kg m", "kg m^2"), "", (6, 6), high=2.0),
            "kg (X Y Z), kg m (mixed), kg m^2 (K M N)",
            "6 x 6",
            "<= 2",
        ),
        (Parameter("a", ("1",), "", ("thrusters",), low=-1.0, high=1.0), "1", "one per thruster", "-1 to 1"),
        (Parameter("a", ("1",), "", ("rates", 6)), "1", "6 per rate", "any"),
    ],
)
def test_units_sizes_and_bounds_in_words(parameter, unit, size, bounds):
    assert (describe.unit(parameter), describe.size(parameter), describe.bounds(parameter)) == (
        unit,
        size,
        bounds,
    )


def test_what_leaving_a_parameter_out_means():
    said = {
        (name, parameter.name): describe.when_left_out(effect, parameter)
        for name, effect in CATALOGUE.items()
        for parameter in effect.parameters
    }
    assert said["added_mass", "matrix"] == "give diagonal instead"
    assert said["surface_suction", "decay"] == "must be given"
    assert said["payload", "mass"] == "0"
