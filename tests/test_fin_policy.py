"""The benchmark of policies with fins: its time limits, and the pilot's row."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks import fin_policy
from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.rl.environment.helmsman import fin_pilot
from hydro.rl.training.build import Builder
from hydro.rl.training.config import TrainingConfig
from hydro.rl.world.config import Settings, Waypoints, World


@pytest.fixture(scope="module")
def builder() -> Builder:
    settings = replace(
        Settings(), world=World(length=120.0, width=60.0, depth=20.0), waypoints=Waypoints(count=1, pace=1.0)
    )
    craft = files.read(bundled("vehicles") / "remus100_fins.toml")[0]
    return Builder(replace(TrainingConfig(), settings=settings), craft)


def test_the_pilot_of_fins_arrives_within_twice_the_time(builder):
    row = fin_policy.flown(builder, fin_pilot, "kernels", 2.0, 4)
    assert row["time limit"] == "36 s"
    assert row["arrived"].startswith("100.0 % (51.0 to 100.0)")
    assert 5.0 < float(row["median time"].removesuffix(" s")) < 36.0


def test_whoever_does_not_move_arrives_nowhere(builder):
    row = fin_policy.flown(builder, lambda seen: 0.0 * fin_pilot(seen), "kernels", 1.0, 2)
    assert row["time limit"] == "18 s"
    assert row["arrived"].startswith("0.0 %")
    assert row["median time"] == ""
