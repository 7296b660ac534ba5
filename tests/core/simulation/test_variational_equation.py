"""Deviations carried along one shot against differences of whole predictions, kind by kind of parameter."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import damped

from hydro.core.identification.levenberg_marquardt import moved
from hydro.core.prediction import multiple_shooting, sensitivity
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.normal_equations import eliminate
from hydro.core.prediction.parameters import free
from hydro.core.recording.arrays import Recording
from hydro.core.recording.shots import CHANNELS, TRUST, make_shots
from hydro.core.simulation.variational_equation import DEVIATION, STIFF, _parts

DT, ROWS = 0.05, 41
QUICK = {"name": "linear_damping", "diagonal": [0.0, 0.0, 0.0, 1000.0, 0.0, 0.0]}
"""Roll decays within a step."""
MEMORY = {"name": "fluid_memory", "K": [[30.0, 40.0, 50.0, 2.0, 5.0, 6.0]], "rates": [1.5]}


@pytest.mark.parametrize("component", range(7))
def test_an_interval_with_a_quick_decay_of_any_component_has_several_steps(component):
    """Six velocities, and an internal state."""
    slope = -0.9 * STIFF / DT * np.eye(DEVIATION + 1)
    slope[:6] *= 9.0  # a pose does not decay
    assert _parts(slope, DT) == 1
    slope[6 + component, 6 + component] *= 2.4
    assert _parts(slope, DT) == 3


def shot():
    """Two seconds of a motion in all axes; no vehicle need ever have moved so."""
    t = np.arange(ROWS) * DT
    waves = np.sin(np.outer(t, np.linspace(0.5, 2.0, 12)) + np.arange(12))
    record = Recording(
        t=t,
        eta=0.3 * waves[:, :6],
        nu=0.4 * waves[:, 6:],
        commands=0.6 * waves[:, :8],
        segments=np.array([[0, ROWS]]),
        after_gap=np.zeros(1, bool),
        session=np.zeros(1, np.int64),
        dt=DT,
    )
    return make_shots(record, sigma=np.repeat([0.02, 0.01, 0.02, 0.01], 3))


@pytest.mark.parametrize(
    ("beside", "effect", "entries"),
    [
        ((), "linear_damping", (1, 5)),
        ((), "thruster_gain", (0, 6)),
        ((), "payload", (0, 4)),
        ((MEMORY,), "fluid_memory", (0, 6)),
        ((QUICK,), "thruster_gain", (0, 6)),
    ],
    ids=["a wrench", "a thrust", "an inertia", "a memory", "a quick decay"],
)
def test_deviations_are_differences_of_predictions(beside, effect, entries):
    vehicle = damped(*beside)
    shots = multiple_shooting.corrected_first(shot(), candidate(vehicle))
    unknown = free(vehicle, [effect])
    changed, steps = moved(unknown, unknown.starts[0])
    base = multiple_shooting.prepare(candidate(vehicle), shots)
    others = [multiple_shooting.prepare(candidate(changed[i]), shots, base) for i in entries]
    steps = [steps[i] for i in entries]
    found = sensitivity.linearise(base, others, steps, shots, threads=1).gram[0]

    still = multiple_shooting.residuals(base, shots)
    begun = [multiple_shooting.displaced(shots.first, 1e-4 * way[None]) for way in np.eye(CHANNELS)]
    columns = [(still - multiple_shooting.residuals(base, shots, first)) / 1e-4 for first in begun]
    columns += [
        (still - multiple_shooting.residuals(other, shots)) / step
        for other, step in zip(others, steps, strict=True)
    ]
    flat = np.stack([*columns, still], axis=-1).reshape(1, shots.residuals, -1)
    expected = eliminate(flat.transpose(0, 2, 1) @ flat, CHANNELS, TRUST**-2)[0][0]
    size = np.sqrt(np.diag(expected))
    assert np.abs((found - expected) / np.outer(size, size)).max() < 0.01
