"""Changes so large that predictions of whole shots are far from linear in them."""

from __future__ import annotations

import msgspec
import polars as pl
import pytest
from recordings import HULL, damped, four_sessions

from hydro.core.diagnosis.pipeline import diagnose
from hydro.core.diagnosis.settings import SURE

UPRIGHT = {"name": "buoyancy_offset", "dx": 0.0, "dy": 0.0, "dz": -0.2}
ROLL = 3
LITTLE_DAMPING = 0.3


def rolling(added: float, *effects):
    """A vehicle that rolls with little damping, and with some added mass in roll [kg m^2]."""
    vehicle = damped(UPRIGHT)
    masses, *others = vehicle.effect
    others = [
        one | {"diagonal": with_roll(one, LITTLE_DAMPING)} if "diagonal" in one else one for one in others
    ]
    table = masses | {"diagonal": with_roll(masses, added)}
    return msgspec.structs.replace(vehicle, effect=(table, *others, *effects))


def with_roll(table, value: float) -> list[float]:
    """The diagonal of a table with another value for roll."""
    return [value if i == ROLL else one for i, one in enumerate(table["diagonal"])]


def flown(added: float, seed: int) -> pl.DataFrame:
    """Four sessions of that vehicle, with a hull that its file does not describe."""
    return four_sessions(rolling(added, HULL), seed)


def test_an_inertia_that_changes_the_phase_within_a_shot_is_named():
    """The vehicle rolled with a period of 0.9 s, and rolls with one of 2 s after the change.

    Fits of whole shots from the file end in a local minimum, because roll is out of phase.
    """
    found = diagnose(rolling(0.01), flown(25.0, 40), before=flown(0.01, 10))
    first = found.findings[0]
    assert first.effect == "added_mass"
    assert first.confidence >= SURE
    assert first.parameters["diagonal"][ROLL] == pytest.approx(25.0, rel=0.02)
