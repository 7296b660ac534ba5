"""How far a name by transfer is believed where no model reaches the noise."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from hydro.core.diagnosis import imperfect
from hydro.core.diagnosis.findings import SURE, Finding, extended
from hydro.core.identification.fit import Fit
from hydro.io import vehicle as files

VEHICLES = Path(__file__).resolve().parents[3] / "datasets" / "vehicles"


def named(x: float) -> Finding:
    """What is said of a payload at x that removes nearly all of the error of left-out data."""
    vehicle = files.read(VEHICLES / "auv151.toml")[0]
    table = {"w": 3.0, "x": x, "y": 0.1, "z": 0.0, "mass": 1.0}
    fit = SimpleNamespace(
        vehicle=extended(vehicle, [{"name": "payload", **table}]), table=lambda effect: (table, {})
    )
    rival = SimpleNamespace(effect="payload", own=False, score=0.98)
    normal = SimpleNamespace(score=np.ones((20, 1)), chi2=50.0)
    model = SimpleNamespace(normal=normal, costs=np.ones(20), excesses=np.full(20, 9.0))
    lesser = SimpleNamespace(costs=np.full(20, 10.0), excesses=np.full(20, 9.0))
    survey = SimpleNamespace(rivals=[rival])
    parts = cast(Any, (rival, survey, model, lesser, cast(Fit, fit), 0.02))
    return imperfect._finding(*parts)


@pytest.mark.parametrize(("lengths", "verdict"), [(0.3, "missing"), (1.7, "suspect")])
def test_a_payload_that_hangs_beside_the_vehicle_is_only_suspected(lengths: float, verdict: str):
    """What transfers with a value beyond what physics leaves stands for something else."""
    vehicle = files.read(VEHICLES / "auv151.toml")[0]
    finding = named(lengths * vehicle.hull.length)
    assert finding.verdict == verdict
    assert finding.confidence is not None
    assert (finding.confidence >= SURE) == (verdict == "missing")
