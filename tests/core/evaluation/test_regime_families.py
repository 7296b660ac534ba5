"""Words for pieces of a recording, against the numbers that they speak of."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import damped

from hydro.core.evaluation.regimes import _commands, _manoeuvres, conditions

OWN = np.array([-0.9, -0.3, -0.01, 0.0, 0.3, 0.9])


def met(found) -> dict[str, list[bool]]:
    return {one.words: one.met.tolist() for one in conditions(list(found))}


@pytest.mark.parametrize(
    ("words", "holds"),
    [
        ("below -50 %", OWN < -0.5),
        ("between -50 and -5 %", (OWN > -0.5) & (OWN < -0.05)),
        ("off", np.abs(OWN) < 0.05),
        ("between +5 and +50 %", (OWN > 0.05) & (OWN < 0.5)),
        ("above +50 %", OWN > 0.5),
        ("below -5 %", OWN < -0.05),
        ("above +5 %", OWN > 0.05),
        ("working", np.abs(OWN) > 0.05),
    ],
)
def test_the_command_of_a_thruster_in_words(words, holds):
    command = np.zeros((len(OWN), 8))
    command[:, 2] = OWN
    assert met(_commands(command, damped()))[f"with T3 {words}"] == holds.tolist()


@pytest.mark.parametrize(
    ("thrusters", "words"),
    [
        ((1, 1, 1, 1, 0, 0, 0, 0), ("powered astern", "using no surge thrust", "powered ahead")),
        ((-1, 1, 1, -1, 0, 0, 0, 0), ("thrusting left", "using no sideways thrust", "thrusting right")),
        ((0, 0, 0, 0, 1, 1, 1, 1), ("thrusting up", "using no vertical thrust", "thrusting down")),
        (
            (-1, 1, -1, 1, 0, 0, 0, 0),
            ("thrusting to turn left", "using no turning thrust", "thrusting to turn right"),
        ),
    ],
)
def test_the_wrench_that_commands_ask_for_in_words(thrusters, words):
    """Four horizontal thrusters at 45 degrees, all pushing ahead, and four that push down."""
    share = np.array([-0.8, 0.0, 0.8])
    found = met(_commands(share[:, None] * np.array(thrusters), damped()))
    assert [found[one] for one in words] == np.eye(3, dtype=bool).tolist()


def test_manoeuvres_in_words():
    """Upside down, what the vehicle calls down is up."""
    motion = np.zeros((6, 18))
    motion[:, 6] = 1.0
    motion[0, 11], motion[1, 11] = -0.5, 0.5
    motion[2, 8], motion[3, 8], motion[3, 3] = 0.5, 0.5, np.pi
    motion[4, 12], motion[5, 12] = -0.5, 0.5
    found = met(_manoeuvres(motion))
    for row, words in enumerate(
        ("turning left", "turning right", "diving", "climbing", "braking", "accelerating")
    ):
        assert np.flatnonzero(found[words]).tolist() == [row], words
    assert np.flatnonzero(found["turning"]).tolist() == [0, 1]
    assert np.flatnonzero(found["changing depth"]).tolist() == [2, 3]
    assert np.flatnonzero(found["changing speed"]).tolist() == [4, 5]
