"""CasADi functions: motion equal to `simulate`, and derivatives equal to finite differences."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest
from export.flown import DT, VEHICLES, apart, commanded, flown, given, vehicle
from export.flown import motion_of_functions as motion_of
from sim.effects import EFFECTS, ETA, NU, with_effect

from hydro.core.columns import MOTION, POSE, VELOCITY
from hydro.core.errors import UsageError
from hydro.core.simulation.simulate import simulate
from hydro.export import casadi_function
from hydro.export.casadi_function import BODY_STATES, functions, lacks, to_casadi

ca = pytest.importorskip("casadi", reason="the extra casadi is not installed")


@pytest.mark.parametrize("name", VEHICLES)
def test_sixty_seconds_are_those_of_simulate(datasets, name):
    commands, motion = flown(datasets, name)
    made = functions(vehicle(datasets, name))
    assert apart(motion_of(made, commands), motion) < 1e-6
    assert made.states[: len(BODY_STATES)] == BODY_STATES
    assert len(made.states) == 13 + commands.shape[1]
    assert np.isfinite(derivatives(made, [0.0] * 6, [0.0] * 6)).all()


def derivatives(made, eta, nu):
    """Return A and B side by side, at zero commands."""
    found = made.jacobian(made.start(eta, nu), np.zeros(len(made.commands)))
    return np.hstack([np.array(one) for one in found])


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_is_held(datasets, effect):
    craft = with_effect(vehicle(datasets, "auv151"), effect)
    table = commanded(8, seconds=1.0)
    state = pl.DataFrame([[*ETA, *NU]] * table.height, schema=[*POSE, *VELOCITY], orient="row")
    moved = simulate(craft, pl.concat([table, state], how="horizontal")).select(MOTION).to_numpy()
    made = functions(craft)
    assert apart(motion_of(made, given(table), ETA, NU), moved) < 1e-7
    assert [one.what for one in lacks(craft)] == (["command delay"] if effect == "command_delay" else [])
    for eta, nu in (([0.0] * 6, [0.0] * 6), (ETA, NU)):
        assert np.isfinite(derivatives(made, eta, nu)).all()


@pytest.mark.parametrize("name", ["auv151", "remus100"])
def test_jacobians_are_those_of_central_differences(datasets, name):
    made = functions(with_effect(vehicle(datasets, name), "fluid_memory"))
    rng = np.random.default_rng(3)
    x, u = np.array(made.start(ETA, NU)).ravel(), rng.uniform(0.2, 0.8, len(made.commands))
    A, B = (np.array(one) for one in made.jacobian(x, u))
    for matrix, at, where in ((A, x, 0), (B, u, 1)):
        for column in range(len(at)):
            aside = np.eye(len(at))[column] * 1e-6
            points = [[x, u] for _ in range(2)]
            points[0][where], points[1][where] = at + aside, at - aside
            rate = (np.array(made.f(*points[0])) - np.array(made.f(*points[1]))).ravel() / 2e-6
            np.testing.assert_allclose(matrix[:, column], rate, atol=2e-6 * max(1.0, abs(rate).max()))


def test_time_is_a_state_where_the_current_changes_with_it(datasets):
    plain = functions(vehicle(datasets, "auv151"))
    changing = functions(with_effect(vehicle(datasets, "auv151"), "current_trend"))
    assert changing.states == (*plain.states, "t")
    assert float(changing.step(changing.start([0] * 6, [0] * 6), [0] * 8)[-1]) == pytest.approx(DT)


def late(craft, delays):
    """Return the vehicle with a delay [s] of each thruster."""
    thrusters = zip(craft.thruster, delays, strict=True)
    return msgspec.structs.replace(
        craft, thruster=tuple(msgspec.structs.replace(one, delay=delay) for one, delay in thrusters)
    )


def test_a_delay_is_held_by_the_step_and_said_of_f(datasets):
    """Delays of zero to several steps, integer or not, give twenty seconds equal to `simulate`."""
    craft = vehicle(datasets, "auv151")
    slow = late(craft, [0.0, 0.02, 0.1, 0.013, 0.051, 0.033, 0.0, 0.1])
    table = commanded(8, seconds=20.0)
    made = functions(slow)
    assert apart(motion_of(made, given(table)), simulate(slow, table).select(MOTION).to_numpy()) < 1e-6
    past = [name for name in made.states if name.startswith("past_")]
    assert [name for name in past if "_T5_" in name] == ["past_T5_1", "past_T5_2", "past_T5_3"]
    assert len(past) == 1 + 5 + 1 + 3 + 2 + 5
    (lack,) = lacks(slow)
    assert lack.what == "command delay"
    assert lack.without == craft


def test_a_long_step_holds_a_delay_shorter_than_itself(datasets):
    slow = late(vehicle(datasets, "auv151"), [0.06] * 8)
    table = commanded(8, seconds=10.0)
    coarse = table.gather_every(5)
    made = functions(slow, length=0.1, substeps=50)
    moved = simulate(slow, coarse).select(MOTION).to_numpy()
    assert apart(motion_of(made, given(coarse)), moved) < 1e-6
    assert sum(name.startswith("past_") for name in made.states) == 8


def test_a_file_holds_all_four_functions_and_loads_as_f(datasets, tmp_path):
    craft, place = vehicle(datasets, "auv151"), tmp_path / "auv.casadi"
    place.write_bytes(to_casadi(craft))
    made = functions(craft)
    x, u = made.start(ETA, NU), [0.3] * 8
    loaded = ca.Function.load(str(place))
    assert (loaded.name(), loaded.name_in(), loaded.name_out()) == ("f", ["x", "u"], ["x_dot"])
    assert np.array_equal(np.array(loaded(x, u)), np.array(made.f(x, u)))
    reader = ca.FileDeserializer(str(place))
    assert [reader.unpack().name() for _ in range(4)] == ["f", "jacobian", "step", "start"]


def test_without_the_extra_it_says_what_to_install(datasets, monkeypatch):
    monkeypatch.setattr(casadi_function.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match="install hydro's extra `casadi`"):
        functions(vehicle(datasets, "auv151"))
