"""What a vehicle remembers along a motion that is known, against the solution of its equation."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
from recordings import damped

from hydro.core.prediction.candidate import candidate, memories

RATE, OMEGA = 3.0, 2.0


def off(dt: float) -> float:
    """Greatest error of a memory of surge, x' = sin(w t) - a x from x(0) = 0, after two seconds."""
    t = np.arange(round(2.0 / dt) + 1) * dt
    nu = np.zeros((len(t), 6))
    nu[:, 0] = np.sin(OMEGA * t)
    record = SimpleNamespace(rows=len(t), t=t, segments=np.array([[0, len(t)]]), dt=dt)
    memory = {"name": "fluid_memory", "K": [[1.0] * 6], "rates": [RATE]}
    vehicle = msgspec.structs.replace(damped(), effect=(memory,))
    found = memories(candidate(vehicle), cast(Any, record), np.zeros_like(nu), nu)[:, 0]
    own = RATE * np.sin(OMEGA * t) - OMEGA * np.cos(OMEGA * t) + OMEGA * np.exp(-RATE * t)
    return float(np.abs(found - own / (RATE**2 + OMEGA**2)).max())


def test_memories_follow_their_equation_to_second_order():
    coarse, fine = off(0.04), off(0.02)
    assert coarse < 2e-3
    assert 3.5 < coarse / fine < 4.5
