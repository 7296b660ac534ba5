"""Replay in MuJoCo with thrust by the supply voltage of each row."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
from bench import DAMPED, neutral

from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Battery, Thruster
from hydro.sim.replay import EFFECTS, replay


def test_a_replay_follows_the_battery() -> None:
    one = Thruster("ahead", position=(0.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0), curve="t200")
    known = msgspec.structs.replace(neutral(), thruster=(one,), battery=Battery(14.0), effect=DAMPED[:1])
    t = np.arange(400) / 50.0
    flown = pl.DataFrame(
        {"session": "a", "t": t, "cmd_1": 0.5 + 0.5 * np.sin(t), "voltage": np.linspace(20.0, 10.0, 400)}
    )
    raw = simulate(known, flown)

    def strayed(given: pl.DataFrame) -> float:
        series, _ = replay(known, given, [EFFECTS])
        return float(np.abs(series.filter(variant="effects")["u"].to_numpy() - raw["u"].to_numpy()).max())

    assert strayed(raw) < 0.01
    assert strayed(raw.drop("voltage")) > 0.1
