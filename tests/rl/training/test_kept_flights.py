"""Stored flights, including the path of a moving goal."""

from dataclasses import replace

import numpy as np
from fleets import QUIET, fleet, neutral

from hydro.rl.training.evaluate import trace
from hydro.rl.world.config import Episode


def test_the_way_of_a_goal_that_moves_is_where_it_was():
    """A goal that moves along one axis counts as moving."""
    subject = fleet(replace(QUIET, task=Episode(steps=6)), craft=neutral())

    def follow(observations):
        subject.goals[0, 1] += 0.5
        return np.zeros((1, 6))

    flight = trace(follow, subject)
    np.testing.assert_allclose(
        flight.way - flight.goal, np.outer(0.5 * np.arange(len(flight.way)), [0, 1, 0])
    )
    assert len(flight.way) == len(flight.t)
    still = trace(lambda observations: np.zeros((1, 6)), fleet(replace(QUIET, task=Episode(steps=6))))
    assert still.way.shape == (0, 3)
