"""A missing effect that refitted values of the file could absorb, in a recording that excites little."""

from __future__ import annotations

from pathlib import Path

import pytest
from sinks import SPEED, sunk

from hydro.core.diagnosis.findings import STATED
from hydro.core.diagnosis.pipeline import diagnose
from hydro.io import vehicle as files

BLUEROV2 = Path(__file__).resolve().parents[3] / "datasets" / "vehicles" / "bluerov2_heavy.toml"
KINDS = ("linear", "quadratic")


def test_three_sinks_show_a_weight_and_no_other_damping() -> None:
    """The drag at the constant speed of the sinks is the weight in water (closed form)."""
    known, _ = files.read(BLUEROV2)
    linear, quadratic = (next(iter(known.effects(f"{name}_damping")))["diagonal"][2] for name in KINDS)
    own = known.rigid_body.mass * known.environment.gravity - known.buoyancy.force
    weight = linear * SPEED + quadratic * SPEED**2 - own

    found = [one for one in diagnose(known, sunk(0, attitude=True)).findings if one.verdict in STATED]
    assert not any("damping" in one.effect for one in found)
    values = {one.effect: one.parameters for one in found}
    added = values["payload"]["w"] if "payload" in values else -values["net_buoyancy"]["dB"]
    assert added == pytest.approx(weight, rel=0.1)
