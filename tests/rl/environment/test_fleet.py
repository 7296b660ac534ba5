"""Batched environment core: start and end of episodes, and exact continuation from a saved state."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from fleets import QUIET, fleet, neutral, put, teachers, vehicle

from hydro.core.errors import DataError, UsageError
from hydro.rl.environment.fleet import Fleet
from hydro.rl.world.config import Episode, Reward, Settings
from hydro.sim.kernel_plant import KernelPlant


def flown(subject, steps, seed=0):
    rng = np.random.default_rng(seed)
    return [subject.step(rng.uniform(-1, 1, (subject.count, 6))) for _ in range(steps)]


def same(one, two):
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.obs, b.obs)
        np.testing.assert_array_equal(a.reward, b.reward)
        np.testing.assert_array_equal(a.info.episode_return, b.info.episode_return)


@pytest.mark.parametrize("make", [fleet, teachers])
def test_a_fleet_goes_on_from_a_state_bit_for_bit(make):
    short = replace(Settings(), task=Episode(steps=25))
    subject = make(short, count=3)
    subject.reset()
    flown(subject, 17)
    state = {name: value.copy() for name, value in subject.state().items()}
    went = flown(subject, 40, seed=1)
    subject.restore(state)
    same(flown(subject, 40, seed=1), went)
    other = make(short, count=3, seed=5)
    other.restore(state)
    same(flown(other, 40, seed=1), went)
    assert any(step.truncated.any() for step in went)


def test_vehicles_do_not_know_of_each_other():
    many, rng = fleet(count=5), np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (60, 5, 6))
    first = many.reset()
    together = [many.step(row).final_obs[0] for row in actions]
    alone = fleet(count=1)
    np.testing.assert_array_equal(alone.reset()[0], first[0])
    np.testing.assert_array_equal([alone.step(row[:1]).final_obs[0] for row in actions], together)


def test_threads_change_no_bit():
    one, two = fleet(count=4), fleet(count=4, threads=2)
    np.testing.assert_array_equal(one.reset(), two.reset())
    same(flown(one, 60), flown(two, 60))


def test_the_same_tasks_in_student_and_teacher_however_they_fly():
    student, teacher = fleet(count=4), teachers(count=4)
    student.reset()
    teacher.reset()
    flown(student, 30)
    flown(teacher, 50, seed=3)
    for _ in range(2):
        student.reset()
        teacher.reset()
        np.testing.assert_array_equal(student.starts, teacher.starts)
        np.testing.assert_array_equal(student.goals, teacher.goals)


def test_an_episode_ends_by_time_and_the_next_begins_in_the_same_step():
    subject = fleet(replace(QUIET, task=Episode(steps=10)), count=2)
    subject.reset()
    for number in range(1, 11):
        step = subject.step(np.zeros((2, 6)))
        assert (step.info.episode_length == number).all()
        assert step.truncated.all() == (number == 10)
    assert not step.terminated.any()
    assert (np.abs(step.obs - step.final_obs).max(axis=1) > 0.1).all()
    np.testing.assert_allclose(subject.plant.pose[:, :3], subject.starts)
    assert (subject.step(np.zeros((2, 6))).info.episode_length == 1).all()


def test_without_renewal_an_ended_episode_waits_for_its_reset():
    subject = fleet(replace(QUIET, task=Episode(steps=3)), count=2)
    subject.reset()
    for _ in range(3):
        step = subject.step(np.zeros((2, 6)), renew=False)
    assert step.truncated.all()
    np.testing.assert_array_equal(step.obs, step.final_obs)
    after = subject.reset(np.array([True, False]))
    np.testing.assert_array_equal(after[1], step.obs[1])
    assert (after[0] != step.obs[0]).any()


@pytest.mark.parametrize(
    ("at", "pillars"),
    [((23.0, 6.0, 4.0), ()), ((12.0, 11.5, 4.0), ()), ((12.0, 6.0, 7.6), ()), ((12.0, 6.0, 0.3), ()),
     ((12.0, 6.0, 4.0), ((12.9, 6.0),))],
)  # fmt: skip
def test_driving_into_something_ends_the_episode_at_a_cost(at, pillars):
    subject = fleet(craft=neutral())
    put(subject, at=at, goal=(4.0, 3.0, 4.0), pillars=pillars)
    toward = np.sign(np.array(at) - (12.0, 6.0, 4.0)) if not pillars else np.array([1.0, 0.0, 0.0])
    action = np.array([[*toward, 0.0, 0.0, 0.0]])
    for _ in range(60):
        step = subject.step(action, renew=False)
        if step.terminated[0]:
            break
    assert step.info.collision[0]
    assert not step.info.success[0]
    assert not step.truncated[0]
    assert step.reward[0] < -8.0


def test_arriving_ends_the_episode():
    subject = fleet(craft=neutral())
    put(subject, goal=(12.4, 6.0, 4.0))
    step = subject.step(np.zeros((1, 6)), renew=False)
    assert step.terminated[0]
    assert step.info.success[0]
    assert step.info.distance[0] == pytest.approx(0.4, abs=1e-3)


def throw(plant, number, speed):
    """Give a vehicle a speed [m/s] that no integrator survives."""
    state = plant._fleet.y[:, 7] if isinstance(plant, KernelPlant) else plant._student.batch.qvel[:, 0]
    state[number] = speed


@pytest.mark.parametrize("engine", ["kernels", "mujoco"])
def test_a_diverged_vehicle_is_told_and_starts_anew(engine):
    """A vehicle too fast for the integrator is reset; its last valid state is observed."""
    subject = fleet(replace(QUIET, engine=engine), count=2)
    subject.reset()
    throw(subject.plant, 0, 1e12)
    step = subject.step(np.zeros((2, 6)))
    assert list(step.info.diverged) == [True, False]
    assert step.terminated[0]
    assert np.isfinite(step.final_obs).all()
    assert np.isfinite(step.obs).all()
    again = subject.step(np.zeros((2, 6)))
    assert not again.info.diverged.any()
    assert (again.info.episode_length == [1, 2]).all()


@pytest.mark.parametrize("engine", ["kernels", "mujoco"])
def test_divergence_costs_what_a_collision_does(engine):
    others = ("shaping", "heading", "upright", "energy", "action", "smoothness", "obstacle")
    only = Reward(**dict.fromkeys(others, 0.0))
    settings = replace(QUIET, reward=only, engine=engine)
    subject = fleet(settings, count=2, craft=neutral(), condition="R_0")
    subject.reset()
    subject.pillars[:] = np.nan
    throw(subject.plant, 0, 1e12)
    step = subject.step(np.zeros((2, 6)), renew=False)
    assert list(step.info.diverged) == [True, False]
    np.testing.assert_array_equal(step.reward, [-only.collision, 0.0])


def test_speeds_that_are_not_plausible_are_counted_and_end_nothing():
    subject = fleet(condition="R_0", craft=neutral())
    put(subject, at=(3.0, 6.0, 4.0), velocity=(5.5, 0, 0, 0, 0, 0), goal=(23.0, 3.0, 4.0))
    steps = [subject.step(np.zeros((1, 6)), renew=False) for _ in range(3)]
    assert all(step.info.overspeed[0] for step in steps)
    assert steps[-1].info.episode_overspeed[0] == 3
    assert not steps[-1].terminated[0]


def test_energy_is_the_time_at_full_thrust():
    """After the lag has settled, surge at its limit needs full power of the four horizontal thrusters."""
    subject = fleet(craft=neutral())
    put(subject, at=(3.0, 6.0, 4.0), goal=(23.0, 3.0, 4.0))
    surge = np.array([[1.0, 0, 0, 0, 0, 0]])
    steps = [subject.step(surge, renew=False) for _ in range(60)]
    spent = steps[-1].info.episode_energy[0] - steps[-11].info.episode_energy[0]
    assert spent == pytest.approx(10 * 0.04 * 0.5, rel=1e-3)


def test_conditions_fly_differently():
    drag = {}
    for condition in ("R_0", "R_effects"):
        subject = fleet(condition=condition, craft=neutral())
        put(subject, at=(4.0, 6.0, 4.0), velocity=(2.0, 0, 0, 0, 0, 0), goal=(20.0, 3.0, 4.0))
        subject.step(np.zeros((1, 6)), renew=False)
        drag[condition] = 2.0 - subject.plant.velocity[0, 0]
    assert abs(drag["R_0"]) < 1e-9
    assert drag["R_effects"] == pytest.approx(0.04 * (15 * 2 + 95 * 4) / 186, rel=0.05)


def test_a_level_counts_from_the_next_episode_on():
    subject = fleet(count=2)
    subject.reset()
    subject.set_level("pillar_row", 5)
    assert np.isnan(subject.pillars).all()
    subject.reset()
    assert (np.isfinite(subject.pillars[:, :, 0]).sum(axis=1) == 5).all()
    with pytest.raises(UsageError, match="needs a path planner"):
        subject.set_level("forest", 5)


BELOW = np.array([0.0, 0.0, 1.0])


class Rail:
    """Guidance to a point 1 m below the goal that records its callers."""

    def __init__(self):
        self.asked, self.goals = [], None

    def reset(self, mask, starts, goals, pillars):
        self.goals = goals.copy()

    def targets(self, mask, positions):
        self.asked.append(mask.copy())
        return self.goals + BELOW, np.full(len(mask), 0.125)

    def state(self):
        return {"goals": self.goals}

    def restore(self, state):
        self.goals = state["goals"].copy()


def test_what_is_led_follows_its_guidance():
    rail, plain = Rail(), fleet(count=2)
    guided = Fleet(QUIET, fleet(count=2).plant, guidance=rail)
    guided.set_level("pillar_row", 4, led=True)
    plain.set_level("pillar_row", 4)
    seen, wanted = guided.reset(), plain.reset()
    np.testing.assert_array_equal(guided.targets, guided.goals + BELOW)
    np.testing.assert_array_equal(seen[:, 3:], wanted[:, 3:])
    assert (np.abs(seen[:, :3] - wanted[:, :3]).max(axis=1) > 0.5).all()
    one, two = guided.step(np.zeros((2, 6))), plain.step(np.zeros((2, 6)))
    np.testing.assert_allclose(one.reward, two.reward - 0.125, atol=1e-6)
    guided.reset(np.array([True, False]))
    assert [list(mask) for mask in rail.asked] == [[True, True], [True, True], [True, False]]
    assert "guidance/goals" in guided.state()


@pytest.mark.parametrize(
    ("actions", "word"),
    [(np.zeros((3, 6)), "shape"), (np.zeros(6), "shape"), ([[0, 0, np.nan, 0, 0, 0]], "finite")],
)
def test_bad_actions_are_refused(actions, word):
    subject = fleet()
    subject.reset()
    with pytest.raises(DataError, match=word):
        subject.step(actions)


def test_a_vehicle_without_some_axis_ignores_its_demand():
    craft = vehicle()
    level = msgspec.structs.replace(craft, thruster=craft.thruster[:4])
    subject = fleet(craft=level)
    subject.reset()
    subject.step([[0, 0, 1.0, 1.0, 1.0, 0]])
    assert (subject.plant.thrust == 0.0).all()
