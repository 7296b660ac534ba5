"""Powers by which the water's force grows, against laws that are known."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest

from hydro.core.columns import POSE, VELOCITY
from hydro.core.effects.formula import joined, one_term
from hydro.core.evaluation.growth import growth, without_hull_water
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.io import vehicle as files

ROWS = 3000


@pytest.fixture(scope="module")
def known(datasets):
    return files.read(datasets / "vehicles" / "auv151.toml")[0]


def recorded(vehicle, noise=True):
    """Four sessions of sines on all thrusters."""
    tables = []
    for seed in range(4):
        rng, t = np.random.default_rng(seed), np.arange(ROWS) * 0.02
        columns = {"session": [f"s{seed}"] * ROWS, "t": t} | {
            name: np.zeros(ROWS) for name in (*POSE, *VELOCITY)
        }
        for i in range(8):
            fast, slow, one, other = (
                *rng.uniform(0.1, 0.4, 1),
                *rng.uniform(0.01, 0.05, 1),
                *rng.uniform(0, 6, 2),
            )
            columns[f"cmd_{i + 1}"] = 0.4 * np.sin(6.3 * fast * t + one) + 0.4 * np.sin(
                6.3 * slow * t + other
            )
        motion = simulate(vehicle, pl.DataFrame(columns | {"z": np.full(ROWS, 10.0)}))
        if noise:
            noisy = disturb(motion.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
            motion = motion.with_columns(pl.DataFrame(noisy, schema=[*POSE, *VELOCITY]))
        tables.append(motion)
    return pl.concat(tables)


@pytest.fixture(scope="module")
def laws(known):
    """Drag with other powers than any file has, along its axes and raised by another speed."""
    along = [
        ("X |u|^n sgn(u)", -110.0, [2.4]),
        ("Y |v|^n sgn(v)", -250.0, [1.4]),
        ("Z |w|^n sgn(w)", -400.0, [2.0]),
    ]
    turned = [
        ("N |r|^n sgn(r)", -40.0, [1.6]),
        ("M |q|^n sgn(q)", -40.0, [2.0]),
        ("K |p|^n sgn(p)", -15.0, [1.5]),
    ]
    raised = [("X |w|^n u", -200.0, [1.0])]
    table = joined([one_term(*one) for one in (*along, *turned, *raised)])
    bare = without_hull_water(known)
    return msgspec.structs.replace(bare, effect=(*bare.effect, table))


@pytest.mark.parametrize("noise", [False, True], ids=["noise-free", "noisy"])
def test_powers_are_those_of_the_law_whatever_the_file_says(known, laws, noise):
    """The file's own damping is another one: it has no part in what is told."""
    found = {(row["axis"], row["against"]): row for row in growth(known, recorded(laws, noise)).to_dicts()}
    for axis, against, power, drag in (
        ("X", "u", 2.4, 110.0),
        ("Y", "v", 1.4, 250.0),
        ("Z", "w", 2.0, 400.0),
        ("N", "r", 1.6, 40.0),
    ):
        row = found[axis, against]
        assert row["power"] == pytest.approx(power, abs=0.15), (axis, row)
        assert row["low"] - 0.1 <= power <= row["high"] + 0.1
        assert row["drag"] == pytest.approx(drag, rel=0.15)
    assert found["X", "w"]["power"] == pytest.approx(1.0, abs=0.3)


def test_a_vehicle_without_water_on_its_hull_has_nothing_that_grows(known):
    bare = without_hull_water(known)
    assert not [e for e in bare.effect if "damping" in e["name"]]
    assert (
        growth(
            known,
            recorded(
                msgspec.structs.replace(
                    bare, effect=(*bare.effect, {"name": "linear_damping", "diagonal": [1e-3] * 6})
                )
            ),
        )
        .filter(pl.col("drag").abs() > 20.0)
        .is_empty()
    )
