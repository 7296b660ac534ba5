"""What changed on an independent simulator, whose hull the vehicle file does not describe."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from hydro.core.diagnosis.pipeline import diagnose
from hydro.io import vehicle as files

ROOT = Path(__file__).resolve().parents[3]
RECORDED = ROOT.parent / "shared" / "data" / "stonefish"


def excerpt(name: str, *, rows: int, every: int, most: int) -> pl.DataFrame:
    sessions = pl.read_parquet(RECORDED / f"{name}.parquet").partition_by("session", maintain_order=True)
    return pl.concat([one.head(rows) for one in sessions[::every]]).head(most)


@pytest.mark.slow
@pytest.mark.skipif(not RECORDED.exists(), reason="the recordings are not here")
def test_a_thruster_at_sixty_per_cent_is_named():
    vehicle, _ = files.read(ROOT / "datasets" / "stonefish" / "vehicle.toml")
    before = excerpt("nominal", rows=750, every=3, most=15_000)
    after = excerpt("v3_thruster3", rows=1500, every=1, most=12_000)
    found = diagnose(vehicle, after, before=before).findings[0]
    assert (found.verdict, found.effect) == ("missing", "thruster_gain")
    assert found.parameters["g"][2] == pytest.approx(-0.4, abs=0.05 * 0.6)
