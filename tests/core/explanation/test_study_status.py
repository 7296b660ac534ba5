"""The headline of a study."""

from __future__ import annotations

import polars as pl
import pytest
from recordings import damped

from hydro.core.diagnosis.findings import Diagnosis, Finding
from hydro.core.explanation.ladder import Step
from hydro.core.explanation.status import study_status
from hydro.core.explanation.with_hull import FLOOR

CURRENT = {"name": "ocean_current", "v_N": 0.2, "v_E": -0.15, "v_D": 0.0}
DAMPING = {"name": "quadratic_damping", "diagonal": [100.0, 200.0, 400.0, 10.0, 40.0, 60.0]}


def step(number: int, found: list[Finding], *tables: dict, axis: str = "all") -> Step:
    """A step that added the first of some tables."""
    ladder, frame = pl.DataFrame({"axis": [axis]}), Diagnosis(tuple(found), damped(), (9.0, 4.0, 1.0)).frame()
    names = tuple(one["name"] for one in tables[:1])
    return Step(number, names, tables, damped(), frame, frame, (9.0, 4.0, 1.0), ladder)


def retuned(confidence: float) -> Finding:
    values = {"diagonal": DAMPING["diagonal"]}
    return Finding("retune", DAMPING["name"], (DAMPING["name"],), confidence=confidence, parameters=values)


def headline(confidence: float, axis: str = "all") -> str:
    missing = Finding("missing", "ocean_current", ("ocean_current",), confidence=1.0, parameters=CURRENT)
    first = step(0, [missing, retuned(confidence)], axis=axis)
    last = step(1, [Finding("nothing_missing")], CURRENT, DAMPING, axis=axis)
    return study_status([first, last], last, 0.02).headline


def test_new_values_of_the_file_are_in_the_headline() -> None:
    assert damped().effects("quadratic_damping")
    told = headline(1.0)
    assert told.startswith("The model needs 2 corrections: A current of 0.25 m/s")
    assert "times the file's value" in told


@pytest.mark.parametrize(("confidence", "axis"), [(0.5, "all"), (1.0, FLOOR)])
def test_unconfirmed_values_of_the_file_are_not_in_the_headline(confidence: float, axis: str) -> None:
    """Nor are those of a change: the file's own values are held fixed."""
    told = headline(confidence, axis)
    assert "A current of 0.25 m/s" in told
    assert "file's value" not in told
