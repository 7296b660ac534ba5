"""Hand-written pilot: solves every task in time with a map, and collides with obstacles without one."""

from dataclasses import replace

import numpy as np
import pytest
from fleets import vehicle

from hydro.core.effects import changes
from hydro.rl.environment import conditions
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.guidance import Guidance
from hydro.rl.tasks.registry import TASKS
from hydro.rl.training.evaluate import fly, summary
from hydro.rl.training.pilots import WithMap, pilot_of
from hydro.rl.world.config import Settings, Station


def flown(name, level, count=8, settings=Settings(), pilot=None, led=None):  # noqa: B008
    plant = conditions.plant(conditions.Condition(), vehicle(), settings, count)
    fleet = Fleet(settings, plant, 3, Guidance(settings, count))
    fleet.set_level(name, level, led=led)
    return fly(pilot or WithMap(fleet), fleet)


@pytest.mark.parametrize(
    ("name", "level"),
    [("point_to_point", 0), ("slalom", 4), ("forest", 12), ("docking", 0), ("pillar_row", 8)],
)
def test_he_arrives_along_his_way(name, level):
    """The pilot needs little more than half of the time limit, except in the row of pillars."""
    found = summary(flown(name, level))
    assert found["success"] == 1.0
    limit = TASKS[name].steps(Settings()) * Settings().period
    assert found["time_to_goal"] < (0.9 if name == "pillar_row" else 0.6) * limit
    assert found["tracking_error"] < 0.45


@pytest.mark.parametrize(("name", "level"), [("slalom", 1), ("slalom", 4), ("forest", 12), ("pillar_row", 8)])
def test_what_has_to_be_gone_round_asks_for_skill(name, level):
    """The pilot without a map swims straight and collides."""
    assert summary(flown(name, level, pilot=pilot_of(TASKS[name]), led=False))["success"] < 0.5


def test_he_weaves_through_the_slalom_and_goes_round_the_row():
    assert summary(flown("slalom", 4))["alternating"] == 1.0
    assert summary(flown("pillar_row", 8))["alternating"] < 0.2


@pytest.mark.parametrize("name", ["station_keeping", "circle", "helix", "lemniscate"])
def test_he_holds_and_follows(name):
    episodes = flown(name, 0, count=4)
    assert (episodes["outcome"] == "success").all()
    steps = TASKS[name].steps(Settings())
    assert episodes["duration"].to_list() == pytest.approx([steps * Settings().period] * 4)
    assert episodes["tracking_error"].max() < 0.2


def test_holding_succeeds_by_the_error_after_settling():
    strict = replace(Settings(), station=Station(within=1e-4))
    assert summary(flown("station_keeping", 0, count=2, settings=strict))["success"] == 0.0
    late = replace(Settings(), station=Station(settling=19.9, within=0.3))
    early = replace(Settings(), station=Station(settling=0.0, within=0.3))
    errors = [flown("station_keeping", 0, 4, settings)["tracking_error"] for settings in (late, early)]
    assert (errors[0] < errors[1]).all()  # he comes from up to 2 m away


def test_a_dock_asks_for_more_than_to_be_there():
    """The pilot that turns its bow to the goal misses the heading of the dock."""
    plain = flown("docking", 0, pilot=pilot_of(TASKS["point_to_point"]))
    docked = flown("docking", 0)
    assert summary(plain)["success"] < summary(docked)["success"] == 1.0


def test_the_station_lies_in_its_current():
    """A passive vehicle drifts as with the current in its file, bit for bit."""
    settings = Settings()
    plant = conditions.plant(conditions.Condition(), vehicle(), settings, 1)
    fleet = Fleet(settings, plant, 5)
    fleet.set_level("station_keeping")
    fleet.reset()
    moved = changes.in_current(vehicle(), fleet._currents[0])
    other = Fleet(settings, conditions.plant(conditions.Condition(), moved, settings, 1), 5)
    other.reset()
    other.plant.reset(np.ones(1, dtype=bool), fleet.plant.pose.copy(), np.zeros((1, 6)))
    for _ in range(50):
        fleet.step(np.zeros((1, 6)), renew=False)
        other.step(np.zeros((1, 6)), renew=False)
    np.testing.assert_array_equal(fleet.plant.pose, other.plant.pose)
    drifted = fleet.plant.velocity[0, :3]
    assert np.linalg.norm(drifted) > 0.01
