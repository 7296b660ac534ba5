"""The p-value of a screening: chance may choose among the shapes of an effect as the screening does."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from hydro.core.diagnosis import model as module
from hydro.core.diagnosis.model import screened
from hydro.core.identification.suspects import Suspect
from hydro.core.prediction.normal_equations import Normal

SHOTS, ROWS, SHAPES = 60, 40, 5


def noise(seed: int) -> Normal:
    """A problem of one column per shape, and a residual that none of them explains."""
    both = np.random.default_rng(seed).standard_normal((SHOTS, ROWS, SHAPES + 1))
    channels, own = both[..., -1], np.zeros((SHOTS, 0, 1))
    return Normal(both.transpose(0, 2, 1) @ both, ROWS, channels, own)


def test_an_effect_with_many_shapes_has_the_nominal_false_alarm_rate(monkeypatch):
    monkeypatch.setattr(module, "moved", lambda unknown, values: ([], []))
    shapes = [Suspect("thruster_deadband", (None,), (1.0,), dict) for _ in range(SHAPES)]
    found = []
    for seed in range(200):
        problem = SimpleNamespace(linearise=lambda vehicle, changed, steps, seed=seed: noise(seed))
        model = SimpleNamespace(problem=problem, vehicle=None, unknown=None, values=None)
        found.append(screened(model, shapes, SHOTS).p_value)
    assert 0.04 < np.mean(np.array(found) <= 0.1) < 0.17
