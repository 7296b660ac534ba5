"""What a flight would tell, against least squares written out; and that it keeps to the limits."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest
from recordings import damped

from hydro.core.columns import POSE, VELOCITY
from hydro.core.errors import DataError
from hydro.core.experiment.discrimination import Rival, distance, utility
from hydro.core.experiment.flight import Limits, Question, advise
from hydro.core.identification.fit import fit
from hydro.core.prediction.parameters import free
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Buoyancy, Hull, RigidBody, Thruster, Vehicle

NOISE = PROFILES["ordinary"].deviations
POSE_DEEP = np.array([0.0, 0.0, 10.0, 0.0, 0.0, 0.0])


def bar(*effects: dict) -> Vehicle:
    """A weightless bar with one thruster along it: whatever happens, it moves straight ahead."""
    return Vehicle(
        name="bar",
        rigid_body=RigidBody(50.0, (0.0, 0.0, 0.0), ((5.0, 0, 0), (0, 5.0, 0), (0, 0, 5.0))),
        buoyancy=Buoyancy(50.0 * 9.81, (0.0, 0.0, 0.0)),
        hull=Hull(1.0, 0.3, 0.3),
        thruster=(Thruster("T", 20.0, 20.0, wrench=(1.0, 0, 0, 0, 0, 0)),),
        effect=({"name": "linear_damping", "diagonal": [20.0] * 3 + [5.0] * 3}, *effects),
    )


def rival(vehicle: Vehicle, effect: str, known: float) -> Rival:
    """An effect of a vehicle as all that is free, each entry known to this part of its scale."""
    unknown = free(vehicle, [effect])
    count = len(unknown.entries)
    return Rival(effect, unknown, unknown.starts[0], np.eye(count) / known**2)


def question(*rivals: Rival, hidden: tuple[str, ...] = ()) -> Question:
    model = rivals[0]
    ties = (rivals,) if len(rivals) > 1 else ()
    return Question(ties, model, hidden, NOISE, POSE_DEEP, np.zeros((2, 4)))


def test_what_a_rival_imitates_does_not_count():
    rng = np.random.default_rng(0)
    X, e, known = rng.normal(size=(40, 3)), rng.normal(size=40), np.diag([0.5, 2.0, 1.0])
    both = np.column_stack([X, e])
    rows = np.vstack([X, np.linalg.cholesky(known).T])
    left = np.r_[e, np.zeros(3)]
    left = left - rows @ np.linalg.lstsq(rows, left)[0]
    assert distance(both.T @ both, known) == pytest.approx(float(left @ left), rel=1e-9)
    e = X @ [1.0, -2.0, 0.5]
    both = np.column_stack([X, e])
    assert distance(both.T @ both, 1e-9 * np.eye(3)) == pytest.approx(0.0, abs=1e-6)
    assert utility({("a", "b"): 3.0}) < utility({("a", "b"): 1.5, ("a", "c"): 1.5})


def test_rivals_part_by_more_than_their_values_can_make_up_for():
    slow = bar({"name": "thruster_lag", "dT": 0.1})
    late = bar({"name": "command_delay", "d": 0.2})
    limits = Limits(seconds=15.0)
    free_to_move = advise(
        question(rival(slow, "thruster_lag", 10.0), rival(late, "command_delay", 10.0)), limits
    )
    held = advise(question(rival(slow, "thruster_lag", 1e-4), rival(late, "command_delay", 1e-4)), limits)
    (apart,), (raw,) = free_to_move.distances.values(), held.distances.values()
    assert 3.0 < apart < 0.9 * raw
    (error,) = free_to_move.errors
    assert error.name == "thruster_lag.dT"
    assert error.after < error.before


def test_two_names_of_one_value_never_part():
    """Linear damping of 25 and of 20 N s/m: each can be the other, unless its value is known."""
    base = bar()
    other = msgspec.structs.replace(
        base, effect=({"name": "linear_damping", "diagonal": [25.0, 20.0, 20.0] + [5.0] * 3},)
    )
    first = rival(base, "linear_damping", 10.0)
    second = Rival("other", *_parts(rival(other, "linear_damping", 10.0)))
    (apart,) = advise(question(first, second), Limits(seconds=8.0)).distances.values()
    known = Rival("other", *_parts(rival(other, "linear_damping", 1e-4)))
    sure = rival(base, "linear_damping", 1e-4)
    (raw,) = advise(question(sure, known), Limits(seconds=8.0)).distances.values()
    assert raw > 10.0
    assert apart < 0.15 * raw


def _parts(one: Rival) -> tuple:
    return one.unknown, one.values, one.information


@pytest.mark.parametrize("limits", [Limits(space=1.5, seconds=15.0), Limits(thrust=0.3, seconds=15.0)])
def test_every_rival_keeps_to_the_limits(limits):
    slow = bar({"name": "thruster_lag", "dT": 0.1})
    late = bar({"name": "command_delay", "d": 0.1})
    flight = advise(question(rival(slow, "thruster_lag", 1.0), rival(late, "command_delay", 1.0)), limits)
    table = flight.table()
    assert table["cmd_1"].abs().max() <= limits.thrust + 1e-6
    assert sum(one.seconds for one in flight.sessions) <= limits.seconds
    for vehicle in (slow, late):
        moved = simulate(vehicle, table)
        away = moved.select((pl.col("x") ** 2 + pl.col("y") ** 2).sqrt().max()).item()
        assert away <= min(limits.space, flight.space + 0.01)
    words = "\n".join(flight.lines())
    assert "expected to part thruster_lag from command_delay by" in words
    assert "every predicted position stays within" in words


def test_space_counts_from_where_a_motion_begins():
    motion = np.zeros((3, 12))
    motion[:, :2] = [[30.0, -40.0], [31.0, -40.0], [30.0, -38.0]]
    assert Limits(space=2.1).hold(motion)
    assert not Limits(space=1.9).hold(motion)


def test_thrust_is_shared_along_its_curve():
    quadratic = msgspec.structs.replace(
        bar(), thruster=(Thruster("T", 20.0, 20.0, wrench=(1.0, 0, 0, 0, 0, 0), curve="quadratic"),)
    )
    for vehicle in (bar(), quadratic):
        flight = advise(
            question(rival(vehicle, "linear_damping", 10.0), hidden=("thruster_gain",)),
            Limits(thrust=0.25, seconds=8.0),
        )
        power = 2.0 if vehicle is quadratic else 1.0
        assert flight.table()["cmd_1"].abs().max() ** power <= 0.25 + 1e-6


def test_a_place_too_small_is_refused_in_a_line():
    tied = question(
        rival(bar({"name": "ocean_current", "v_N": 0.5, "v_E": 0.0, "v_D": 0.0}), "ocean_current", 1.0),
        rival(bar({"name": "net_buoyancy", "dB": 5.0}), "net_buoyancy", 1.0),
    )
    with pytest.raises(DataError, match=r"no manoeuvre keeps every prediction within 0\.2 m") as told:
        advise(tied, Limits(space=0.2))
    assert "\n" not in str(told.value)
    for wrong in ({"depth": (5.0, 3.0)}, {"space": 0.0}, {"thrust": 1.5}, {"seconds": 1.0}):
        with pytest.raises(DataError):
            Limits(**wrong)
    with pytest.raises(DataError, match="leaves nothing open"):
        advise(question(rival(bar(), "linear_damping", 1.0)), Limits())


def test_expected_standard_errors_are_those_of_a_fit_to_the_flight():
    vehicle = damped()
    model = rival(vehicle, "linear_damping", 0.1)
    asked = advise(question(model, hidden=("net_buoyancy",)), Limits(seconds=60.0))
    (expected,) = asked.errors
    flown = simulate(vehicle, asked.table())
    noisy = disturb(flown.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], np.random.default_rng(1))
    logged = flown.with_columns(pl.DataFrame(noisy, schema=[*POSE, *VELOCITY]))
    found = fit(vehicle, logged, ["linear_damping", "net_buoyancy"], noise=NOISE)
    (table,) = (one for one in found.tables() if one["name"] == "net_buoyancy")
    assert expected.after == pytest.approx(table["standard_error"]["dB"], rel=0.5)
