"""Reproduction of the bundled recordings by Stonefish itself.

With HYDRO_STONEFISH_RECORD=1 the exchanges that the other tests replay are recorded again.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest
from stonefish_cases import ALL, HERE, VEHICLE, WALK, craft, flown_twice, program, replayed

from hydro import cli
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Buoyancy, Vehicle
from hydro.core.vehicle.frames import quaternion_from_euler, rotation
from hydro.io import table
from hydro.sim.stonefish.plant import StonefishPlant
from hydro.sim.stonefish.program import NAME, VARIABLE, Program
from hydro.sim.stonefish.recorder import stonefish_teacher

PROGRAM = shutil.which(os.environ.get(VARIABLE, NAME))
RECORD = bool(os.environ.get("HYDRO_STONEFISH_RECORD"))
pytestmark = [
    pytest.mark.stonefish,
    pytest.mark.skipif(PROGRAM is None, reason=f"{NAME} is not installed (docs/stonefish.md)"),
]


@pytest.fixture(autouse=True)
def recorded(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Record the exchange of a test on request."""
    of = {"flight": "bundled_replay", "plant": "goes_back", "walk": "session"}
    names = [name for name, part in of.items() if part in request.node.name]
    if RECORD and names:
        path = program(tmp_path, HERE / "exchange.py", HERE / f"{names[0]}.txt", PROGRAM)
        monkeypatch.setenv(VARIABLE, str(path))


def test_the_bundled_replay_is_flown_again():
    wanted, motion = replayed(60 if RECORD else 4500)
    assert np.abs(motion[:, 6:] - wanted[:, 6:]).max() < 0.01
    assert np.abs(motion[:, :3] - wanted[:, :3]).max() < 0.05


def test_a_plant_goes_back_bit_for_bit():
    _, first, again = flown_twice()
    np.testing.assert_array_equal(first, again)


def test_a_session_is_recorded(tmp_path):
    assert cli.main([*map(str, WALK), "-o", str(tmp_path / "raw.parquet")]) == 0
    assert table.read(tmp_path / "raw.parquet").frame.height == 100


def test_buoyancy_is_the_files_and_not_the_meshs():
    """A neutral vehicle with coincident centres stays at rest in any attitude."""
    plant = StonefishPlant(floating(rise=0.0), period=0.02)
    plant.reset(ALL, tilted(0.7), np.zeros((1, 6)))
    for _ in range(10):
        plant.step(np.zeros((1, 8)))
    assert np.abs(plant.velocity).max() < 1e-9
    np.testing.assert_allclose(plant.specific_force[0], -9.81 * rotation(0.7, 0.0, 0.0)[2], atol=1e-9)


def test_a_righting_moment_turns_it_as_its_inertia_says():
    """At a heel of 0.3 rad, p = -B h sin(0.3) t / I_x at first: Stonefish adds no inertia about surge."""
    rise, heel, known = 0.02, 0.3, craft()
    plant = StonefishPlant(floating(rise=rise), period=0.002)
    plant.reset(ALL, tilted(heel), np.zeros((1, 6)))
    plant.step(np.zeros((1, 8)))
    moment = known.rigid_body.mass * known.environment.gravity * rise * np.sin(heel)
    assert plant.velocity[0, 3] == pytest.approx(-moment * 0.002 / known.rigid_body.inertia[0][0], rel=1e-6)


def test_thrust_grows_as_its_lag_says():
    plant = StonefishPlant(craft(), period=0.02)
    plant.reset(ALL, tilted(0.0), np.zeros((1, 6)))
    for _ in range(5):
        plant.step(np.full((1, 8), 0.5))
    np.testing.assert_allclose(plant.thrust, 0.5 * 155.0 * (1.0 - np.exp(-0.1 / 0.15)), rtol=1e-6)


def test_a_plant_drifts_with_the_water_and_goes_on_with_another_vehicle():
    """A vehicle released at the speed of a current keeps it; a changed vehicle acts from its next reset."""
    current = {"name": "ocean_current", "v_N": 0.3, "v_E": -0.2}
    adrift = msgspec.structs.replace(floating(rise=0.0), effect=(current,))
    plant = StonefishPlant(floating(rise=0.0), count=2, period=0.02)
    both, start = np.ones(2, dtype=bool), np.repeat(tilted(0.0), 2, axis=0)
    moving = np.tile([0.3, -0.2, 0.0, 0.0, 0.0, 0.0], (2, 1))
    plant.reset(both, start, moving)
    plant.change({1: adrift})
    plant.step(np.zeros((2, 8)))
    np.testing.assert_array_equal(*plant.velocity)
    plant.reset(both, start, moving)
    for _ in range(10):
        plant.step(np.zeros((2, 8)))
    np.testing.assert_allclose(plant.velocity[1], moving[1], atol=1e-6)
    assert np.hypot(*plant.velocity[0, :2]) < 0.999 * np.hypot(0.3, 0.2)


def test_a_vehicle_beyond_all_numbers_is_told():
    plant = StonefishPlant(craft())
    plant.reset(ALL, tilted(0.0), np.full((1, 6), 1e200))
    plant.step(np.zeros((1, 8)))
    assert plant.diverged[0]
    assert np.isfinite(plant.pose).all()
    plant.reset(ALL, tilted(0.0), np.zeros((1, 6)))
    assert not plant.diverged[0]


@pytest.mark.parametrize(
    ("line", "told"),
    [("dance 1", "no such request"), ("hold 1 0", "hold before reset"), ("reset 1", "finite number")],
)
def test_a_bad_request_ends_it_with_a_reason(line, told):
    with Program(stonefish_teacher(craft()).scenario) as asked:
        asked._ask(line)
        with pytest.raises(DataError, match=told):
            asked.answer()


def floating(rise: float) -> Vehicle:
    """Return the neutral vehicle of the paper, with buoyancy acting `rise` [m] above the mass."""
    known = craft()
    body = msgspec.structs.replace(known.rigid_body, center_of_gravity=(0.02, 0.0, 0.02))
    lift = Buoyancy(body.mass * known.environment.gravity, (0.02, 0.0, 0.02 - rise))
    return msgspec.structs.replace(known, rigid_body=body, buoyancy=lift, effect=())


def tilted(heel: float) -> np.ndarray:
    """Return a pose (1, 7) at a depth of 20 m."""
    return np.concatenate([[0.0, 0.0, 20.0], quaternion_from_euler(heel, 0.0, 0.0)])[None]


def test_a_pilot_by_hand_reaches_his_goals(tmp_path):
    out = tmp_path / "result.parquet"
    line = ["rl", "eval", VEHICLE, "--in", "stonefish", "--episodes", 2, "-o", out]
    assert cli.main(list(map(str, line))) == 0
    result = table.read(out, "evaluations").frame
    assert result.select("plant", "success").rows() == [("stonefish", 1.0)]
