"""Domain randomisation: random draws, each of which acts like the effect that it represents."""

from dataclasses import replace

import numpy as np
import pytest
from fleets import QUIET, fleet, neutral, teachers, vehicle

from hydro.core.effects import changes, inertia_matrix, thruster_table
from hydro.core.errors import UsageError
from hydro.core.simulation.estimates import Estimate, Estimates
from hydro.core.vehicle.thrusters import GAIN
from hydro.rl.environment import conditions
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.randomiser import Randomiser
from hydro.rl.world.config import Randomisation, Settings
from hydro.sim.plant import StudentPlant
from hydro.sim.teacher_plant import TeacherPlant

STILL = np.zeros(3)


def randomised(**what):
    return replace(QUIET, randomise=Randomisation(**what))


def drawn(count=40, craft=None, estimates=None, **what):
    randomiser = Randomiser(randomised(**what), craft or vehicle(), 36, estimates)
    return [randomiser.draw(0, k, 0, STILL) for k in range(count)]


def test_nothing_is_drawn_by_default():
    for draw in drawn(3):
        assert draw.vehicle is None
        assert (draw.bias == 0.0).all()
        assert (draw.seen_late, draw.obeyed_late) == (0, 0)


def test_a_draw_is_its_own_whatever_was_drawn_before():
    one = Randomiser(randomised(box=0.2, current=0.3), vehicle(), 36)
    one.draw(5, 1, 2, STILL)
    two = Randomiser(randomised(box=0.2, current=0.3), vehicle(), 36)
    assert one.draw(5, 3, 7, STILL).vehicle == two.draw(5, 3, 7, STILL).vehicle
    assert one.draw(5, 3, 8, STILL).vehicle != two.draw(5, 3, 7, STILL).vehicle


def test_a_box_is_as_wide_as_it_says():
    """Every number of the file's damping varies within 20 % and reaches both ends."""
    given = vehicle().effects("quadratic_damping")[0]["diagonal"]
    found = np.array([d.vehicle.effects("quadratic_damping")[0]["diagonal"] for d in drawn(200, box=0.2)])
    shares = found / np.array(given)
    assert shares.min() > 0.8 - 1e-9
    assert shares.max() < 1.2 + 1e-9
    assert shares.min() < 0.82
    assert shares.max() > 1.18
    assert np.corrcoef(shares[:, :2].T)[0, 1] == pytest.approx(0.0, abs=0.2)


def test_a_posterior_has_the_covariance_it_is_drawn_from():
    diagonal = vehicle().effects("quadratic_damping")[0]["diagonal"]
    entries = tuple(Estimate("quadratic_damping", "diagonal", (i,), "kg/m", diagonal[i]) for i in (0, 1))
    covariance = np.array([[4.0, 3.0], [3.0, 9.0]])
    draws = drawn(600, estimates=Estimates(entries, covariance), posterior=True)
    found = np.array([d.vehicle.effects("quadratic_damping")[0]["diagonal"][:2] for d in draws])
    np.testing.assert_allclose(found.mean(axis=0), diagonal[:2], atol=0.5)
    np.testing.assert_allclose(np.cov(found.T), covariance, rtol=0.25)


def test_without_a_covariance_there_is_no_posterior():
    with pytest.raises(UsageError, match=r"no covariance.*together with its \.covariance\.parquet"):
        drawn(1, posterior=True)


def test_currents_loads_and_thrusters_are_no_greater_than_they_say():
    limit = drawn(60, current=0.3, load=0.1, thruster=1.0)
    full = drawn(60, current=0.3, load=0.1, thruster=1.0, full=True)
    for draws, least in ((limit, 0.0), (full, 1.0 - 1e-9)):
        flows = [draw.vehicle.effects("ocean_current")[0] for draw in draws]
        speeds = np.hypot([flow["v_N"] for flow in flows], [flow["v_E"] for flow in flows])
        assert (speeds <= 0.3 + 1e-12).all()
        assert (speeds >= 0.3 * least).all()
        for draw in draws:
            more = inertia_matrix(draw.vehicle)[0, 0] - inertia_matrix(vehicle())[0, 0]
            assert 15.1 * least - 1e-6 <= more <= 15.1 + 1e-9
            gains = thruster_table(draw.vehicle)[:, GAIN]
            assert (gains < 0.0).sum() == 1
            assert -1.0 - 1e-12 <= gains.min() <= -least
    towards = np.arctan2([f["v_E"] for f in flows], [f["v_N"] for f in flows])
    assert towards.min() < -2.0
    assert towards.max() > 2.0
    assert len({int(thruster_table(draw.vehicle)[:, GAIN].argmin()) for draw in full}) == 8


@pytest.mark.parametrize("make", [StudentPlant, TeacherPlant])
def test_vehicles_of_their_own_fly_as_they_do_alone(make):
    """Three different vehicles give the same bits together and alone."""
    crafts = [
        changes.in_current(vehicle(), np.array([0.2, -0.1, 0.0])),
        vehicle(),
        changes.weakened(changes.with_payload(vehicle(), 15.0, 20.0, (0.2, 0.0, 0.1)), 2, 1.0),
    ]
    pose, velocity = np.zeros((3, 7)), np.zeros((3, 6))
    pose[:, 2:4] = 4.0, 1.0
    commands = np.random.default_rng(0).uniform(-1.0, 1.0, (15, 3, 8))
    together = make(vehicle(), count=3)
    together.change({0: crafts[0], 2: crafts[2]})
    together.reset(np.ones(3, dtype=bool), pose, velocity)
    for row in commands:
        together.step(row)
    for k, craft in enumerate(crafts):
        alone = make(craft, count=1)
        alone.reset(np.ones(1, dtype=bool), pose[:1], velocity[:1])
        for row in commands:
            alone.step(row[k : k + 1])
        np.testing.assert_array_equal(alone.pose[0], together.pose[k])
    assert (together.thrust[2, 2] == 0.0).all()
    together.change({0: vehicle(), 2: vehicle()})
    together.reset(np.ones(3, dtype=bool), pose, velocity)
    for row in commands:
        together.step(np.repeat(row[:1], 3, axis=0))
    assert (together.pose == together.pose[1]).all()


def test_a_current_is_a_frame_that_drifts():
    """Galilean invariance: in a current, the pose of a flight in still water drifts with the water."""
    flow = np.array([0.3, -0.2, 0.0])
    still, moved = (StudentPlant(craft) for craft in (vehicle(), changes.in_current(vehicle(), flow)))
    pose = np.array([[5.0, 5.0, 4.0, 1.0, 0.0, 0.0, 0.0]])
    over_ground = np.concatenate([flow, np.zeros(3)])[None]
    one = np.ones(1, dtype=bool)
    still.reset(one, pose, np.zeros((1, 6)))
    moved.reset(one, pose, over_ground)
    for row in np.random.default_rng(1).uniform(-1.0, 1.0, (50, 1, 8)):
        still.step(row)
        moved.step(row)
    np.testing.assert_allclose(moved.pose[0, :3], still.pose[0, :3] + 50 * 0.04 * flow, atol=1e-6)
    np.testing.assert_allclose(moved.pose[0, 3:], still.pose[0, 3:], atol=1e-7)


@pytest.mark.parametrize("make", [fleet, teachers])
def test_a_fleet_of_drawn_vehicles_goes_on_from_a_state_bit_for_bit(make):
    settings = replace(
        randomised(box=0.2, current=0.3, load=0.1, thruster=0.5, bias=1.0, delay=0.12, late=0.08),
        task=replace(Settings().task, steps=12),
        history=2,
    )
    subject, other = make(settings, count=3), make(settings, count=3, seed=4)
    rng = np.random.default_rng(0)
    subject.reset()
    other.reset()
    actions = rng.uniform(-1.0, 1.0, (30, 3, 6))
    for row in actions[:10]:
        subject.step(row)
    state = {name: value.copy() for name, value in subject.state().items()}
    went = [subject.step(row).obs for row in actions[10:]]
    for one in (subject, other):
        one.restore(state)
        np.testing.assert_array_equal([one.step(row).obs for row in actions[10:]], went)


def test_late_commands_are_obeyed_late():
    late = replace(randomised(late=0.08, full=True))
    prompt, delayed = fleet(QUIET, craft=neutral()), fleet(late, craft=neutral())
    surge = np.array([[1.0, 0, 0, 0, 0, 0]])
    prompt.reset()
    delayed.reset()
    first = [prompt.step(surge, renew=False).obs[0, 3] for _ in range(4)]
    second = [delayed.step(surge, renew=False).obs[0, 3] for _ in range(6)]
    np.testing.assert_allclose(second[2:], first, atol=1e-6)
    assert abs(second[1]) < 1e-6


def test_late_sensors_tell_of_the_past_and_history_remembers_it():
    settings = replace(randomised(delay=0.08, full=True), history=3)
    delayed, prompt = fleet(settings, craft=neutral()), fleet(QUIET, craft=neutral())
    seen, now = [delayed.reset()[0]], [prompt.reset()[0]]
    for action in np.random.default_rng(0).uniform(-1.0, 1.0, (8, 1, 6)):
        seen.append(delayed.step(action, renew=False).obs[0])
        now.append(prompt.step(action, renew=False).obs[0])
    assert seen[0].shape == (108,)
    np.testing.assert_array_equal(seen[8], np.concatenate([now[6], now[5], now[4]]))
    np.testing.assert_array_equal(seen[1], np.tile(now[0], 3))


def test_a_bias_stays_for_an_episode():
    biased = fleet(replace(Settings(), randomise=Randomisation(bias=50.0)), craft=neutral())
    biased.reset()
    depths = np.array([biased.step(np.zeros((1, 6)), renew=False).obs[0, 16] for _ in range(20)])
    off = depths - biased.plant.pose[0, 2]
    assert abs(off.mean()) > 5.0 * off.std()


def test_another_vehicle_may_be_the_truth():
    """Demands are computed for the assumed vehicle; another one with as many thrusters is simulated."""
    weak = changes.weakened(vehicle(), 0, 1.0)
    plant = conditions.plant(conditions.Condition(), weak, QUIET, 1)
    flown = Fleet(QUIET, plant, believed=vehicle())
    flown.reset()
    flown.step(np.array([[1.0, 0, 0, 0, 0, 0]]))
    assert flown.plant.thrust[0, 0] == 0.0
    assert flown._commands[0, 0] == flown._commands[0, 1] > 0.0
    import msgspec

    other = msgspec.structs.replace(vehicle(), thruster=vehicle().thruster[:4])
    with pytest.raises(UsageError, match="give a true vehicle with the same number"):
        Fleet(QUIET, plant, believed=other)


@pytest.mark.parametrize("wrong", [{"box": 1.5}, {"thruster": -0.1}, {"current": -1.0}, {"late": np.inf}])
def test_what_cannot_be_drawn_is_refused(wrong):
    with pytest.raises(UsageError, match=f"randomise.{next(iter(wrong))}"):
        Randomisation(**wrong)
