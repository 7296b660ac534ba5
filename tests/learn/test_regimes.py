"""Motion regimes: assignment of rows by their motion, and errors by regime."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

from hydro.core.errors import UsageError
from hydro.learn import rows
from hydro.learn.evaluate import evaluate, predict
from hydro.learn.regimes import regimes
from hydro.learn.train import train

MODEL = SimpleNamespace(scalers={"input_mean": np.full(12, 0.5), "input_scale": np.full(12, 0.25)})


def sides(by: str, nu) -> dict[str, np.ndarray]:
    return dict(regimes(MODEL, np.repeat(np.asarray(nu, float), 20, axis=0), by))


def test_speed_and_drift():
    nu = [[0.3, 0, 0, 9, 9, 9], [0, 2.0, 0, 0, 0, 0], [-0.5, 0.0, 0.0, 0, 0, 0], [0.01, 0.01, 0, 0, 0, 0]]
    speed = sides("speed", nu)
    assert list(speed) == ["speed 0-0.25 m/s", "speed 0.25-0.5 m/s", "speed 0.5-1 m/s", "speed above 1.5 m/s"]
    assert speed["speed 0.5-1 m/s"][40:60].all()
    drift = sides("drift", nu)
    assert drift["drift 0-15 deg"].sum() == 20
    assert drift["drift 90-135 deg"][20:40].all()
    assert drift["drift 135-180 deg"][40:60].all()
    assert sum(chosen.sum() for chosen in drift.values()) == 60, "below 0.05 m/s there is no drift angle"


def test_reach_is_that_of_the_furthest_velocity():
    near, far = np.full(6, 0.5), np.full(6, 0.5)
    far[4] = 0.5 - 4 * 0.25
    reach = sides("reach", [near, far])
    assert list(reach) == ["reach 0-1 sigma", "reach above 3 sigma"]
    assert reach["reach above 3 sigma"][20:].all()


def test_few_rows_are_no_regime():
    assert not dict(regimes(MODEL, np.ones((19, 6)), "speed"))


def test_errors_by_regime_are_of_its_rows(table):
    split = table(600)
    model = train(split, model="mlp", epochs=2)
    metrics = evaluate([model], split, by=["speed"])
    chosen = rows.of_part(split, "test")
    speed = np.linalg.norm(rows.states(chosen)[:, :3], axis=1)
    fast = chosen.filter(pl.Series((speed >= 1.0) & (speed < 1.5)))
    error = predict(model, rows.states(fast)) - rows.wrenches(fast)
    found = metrics.filter(variant="speed 1-1.5 m/s", axis="all", metric="rmse")["value"].item()
    assert found == pytest.approx(np.sqrt((error**2).mean()))
    assert metrics.filter(variant="").equals(evaluate([model], split))
    with pytest.raises(UsageError, match="by speed, drift, reach, not by 'depth'"):
        evaluate([model], split, by=["depth"])


def test_minutes_are_whole_blocks_and_more_keep_those_of_fewer(table):
    split = table(4000)
    few, more = (rows.for_minutes(split, minutes) for minutes in (0.1, 0.3))
    kept = [set(frame.filter(part="train")["block"]) for frame in (few, more)]
    assert [len(one) for one in kept] == [6, 18]  # blocks of 50 rows, 0.02 s apart
    assert kept[0] < kept[1]
    assert few.filter(part="test").equals(split.filter(part="test"))
    assert rows.for_minutes(split, 1e6).equals(split)
    with pytest.raises(UsageError, match="above 0"):
        rows.for_minutes(split, 0.0)
