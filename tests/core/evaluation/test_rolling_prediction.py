"""Predictions begun anew every 20 s: the true vehicle stays on its track, and another one leaves it."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest

from hydro.core.evaluation import rolling_prediction
from hydro.core.evaluation.rolling_prediction import MEASURED, restarted
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.io import schema
from hydro.io import vehicle as files


@pytest.fixture(scope="module")
def known(datasets) -> Vehicle:
    return files.read(datasets / "vehicles" / "auv151.toml")[0]


def flown(vehicle: Vehicle, seconds: float, session: str = "a") -> pl.DataFrame:
    t = np.arange(round(seconds / 0.02)) * 0.02
    demand = {f"cmd_{i}": 0.4 * np.sin((0.2 + 0.05 * i) * t + i) for i in range(1, 9)}
    return simulate(vehicle, pl.DataFrame({"session": [session] * len(t), "t": t, **demand}))


def test_the_true_vehicle_predicts_its_own_track(known):
    wrong = msgspec.structs.replace(known, effect=(*known.effect, {"name": "net_buoyancy", "dB": 30.0}))
    raw = flown(known, 50.0)
    table = restarted({"step-0": wrong, "step-1": known}, raw)
    schema.load("replay").check(table, "replay")
    assert table["variant"].unique(maintain_order=True).to_list() == [MEASURED, "step-0", "step-1"]
    measured, buoyant, true = (table.filter(variant=name) for name in (MEASURED, "step-0", "step-1"))
    assert measured["t"].to_list() == raw["t"].to_list()[::5]
    np.testing.assert_allclose(true.select("w", "q", "z"), measured.select("w", "q", "z"), atol=0.02)
    away = np.abs((buoyant["z"] - measured["z"]).to_numpy())
    assert away.max() > 1.0
    assert (away[[0, 200, 400]] < 0.01).all(), "every 20 s it begins where the vehicle was"


def test_only_the_heads_of_the_first_sessions_are_shown(known, monkeypatch):
    monkeypatch.setattr(rolling_prediction, "SHOWN_SECONDS", 4.0)
    monkeypatch.setattr(rolling_prediction, "MOST_SESSIONS", 2)
    raw = pl.concat([flown(known, 6.0, name) for name in "cab"])
    table = restarted({"step-0": known}, raw)
    assert table.select("session", "variant").unique(maintain_order=True).rows() == [
        ("c", MEASURED),
        ("a", MEASURED),
        ("c", "step-0"),
        ("a", "step-0"),
    ]
    assert table["t"].max() == pytest.approx(4.0)


def test_a_motion_without_bounds_ends(known, monkeypatch):
    """Rows that are not numbers are left out; the next beginning is there again."""

    true = rolling_prediction.predict

    def wild(loaded, shots):
        motion = true(loaded, shots)
        motion[:, 100:, 7] = np.inf
        return motion

    monkeypatch.setattr(rolling_prediction, "predict", wild)
    table = restarted({"step-0": known}, flown(known, 21.0))
    schema.load("replay").check(table, "replay")
    shown = table.filter(variant="step-0")["t"]
    assert 0.0 in shown
    assert 20.0 in shown
    assert 19.0 not in shown
