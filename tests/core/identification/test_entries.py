"""Scales, bounds, steps and beginnings of every effect are those by which findings were measured.

`entries.csv` holds numbers kept from the release that measured docs/benchmarks.md; a change of them changes
what is found, and belongs into an ADR.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from hydro.core.effects import CATALOGUE
from hydro.core.identification.suspects import suspects
from hydro.core.prediction.parameters import free
from hydro.io import vehicle as files

KEPT = pl.read_csv(Path(__file__).with_name("entries.csv"), schema_overrides={"starts": pl.String})
REACH = np.array([[0.0, 0.0, 5.0, 0.0], [8.0, 3.0, 7.0, 20.0], [2.0, -4.0, 6.0, 40.0]])
COLUMNS = {
    "added_mass": 6,
    "added_mass_coupling": 5,
    "added_mass_coriolis": 1,
    "linear_damping": 6,
    "quadratic_damping": 6,
    "coupled_damping": 6,
    "cross_axis_drag": 15,
    "crossflow_drag": 2,
    "body_lift": 8,
    "net_buoyancy": 1,
    "buoyancy_offset": 3,
    "payload": 5,
    "ocean_current": 3,
    "tether": 7,
    "surface_suction": 3,
    "fluid_memory": 12,
    "thruster_gain": 8,
    "thruster_asymmetry": 1,
    "thruster_lag": 4,
    "command_delay": 2,
    "thruster_deadband": 5,
    "thruster_curve": 3,
    "thruster_inflow": 1,
    "sensor_scale": 3,
    "sensor_misalignment": 3,
    "sensor_delay": 3,
    "sensor_lever_arm": 3,
    "reference_point": 3,
    "sensor_bias": 3,
}
"""Columns by which each effect is suspected, in this order."""


@pytest.mark.parametrize("name", KEPT["vehicle"].unique().sort())
def test_every_entry_is_what_it_was(datasets, name):
    known = files.read(datasets / "vehicles" / f"{name}.toml")[0]
    kept = {row.pop("entry"): row for row in KEPT.filter(vehicle=name).drop("vehicle").to_dicts()}
    seen = set()
    for effect, record in CATALOGUE.items():
        if record.words or record.is_random:  # nothing of it is there before a file writes it out, or fitted
            continue
        for form in [f"{effect}.{choice}" for choice in record.one_of] or [effect]:
            unknown = free(known, [form], reach=REACH)
            for i, entry in enumerate(unknown.entries):
                if entry.name not in kept:
                    continue
                starts = dict.fromkeys(float(start[i]) for start in unknown.starts)
                found = {field: getattr(entry, field) + 0.0 for field in ("scale", "low", "high", "step")}
                found |= {"resolution": entry.resolution, "starts": " ".join(map(repr, starts))}
                assert found == kept[entry.name], entry.name
                seen.add(entry.name)
    assert seen == set(kept)


def test_the_suspects_come_in_the_order_in_which_they_came(datasets):
    found: dict[str, int] = {}
    for one in suspects(files.read(datasets / "vehicles" / "auv151.toml")[0], reach=REACH):
        found[one.effect] = found.get(one.effect, 0) + len(one.steps)
    assert [(name, count) for name, count in found.items() if name in COLUMNS] == list(COLUMNS.items())
