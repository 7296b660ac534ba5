"""Errors of the velocity sensor that the comparison of pose and velocity shows, whatever forces act."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from hydro.core.columns import Array
from hydro.core.diagnosis.findings import Finding
from hydro.core.effects import CATALOGUE
from hydro.core.experiment import advice
from hydro.core.preprocessing.sensor_tests import VETO, KinematicTest, shown, vetoed
from hydro.core.vehicle.description import Vehicle


def sensor_finding(test: KinematicTest, share: float, dt: float, vehicle: Vehicle) -> Finding:
    """Return the finding of a velocity sensor error that kinematics shows, with its values.

    `share` is the share of the prediction error that a correction of the sensor removes; `dt` [s].
    """
    values = {key: value for key, value in test.table.items() if key != "name"}
    sure = 1.0 - test.p_value
    return Finding.of(
        "retune" if vehicle.effects(test.effect) else "missing",
        test.effect,
        (values, test.errors),
        float(np.clip(share, 0.0, 1.0)),
        confidence=sure,
        p_value=test.p_value,
        advice=f"{advice.adding(test.effect, values, dt)}; kinematics alone shows it, whatever forces act",
        support=sure,
    )


def sure_by_kinematics(finding: Finding, tests: Mapping[str, KinematicTest]) -> Finding | None:
    """Return a named sensor error with the confidence that kinematics alone gives; None if it shows none.

    Error that no force explains does not lower this confidence, because no force can imitate the sensor
    error.
    """
    test = tests.get(finding.effect)
    if test is None or not shown(test) or finding.verdict not in ("missing", "retune"):
        return None
    sure = max(finding.confidence, 1.0 - test.p_value)
    return replace(
        finding, confidence=sure, advice=f"{finding.advice}; kinematics alone shows it, whatever forces act"
    )


def refuted(tests: Mapping[str, KinematicTest], effect: str, vehicle: Vehicle) -> bool:
    """Return whether kinematics contradicts a sensor error that the dynamics suggest."""
    test = tests.get(effect)
    return test is not None and any(vetoed(test, table) for table in vehicle.effects(effect))


def unstated(tests: Mapping[str, KinematicTest], vehicle: Vehicle) -> list[KinematicTest]:
    """Return tests that show an error of the velocity sensor that differs from the values of the file."""
    return [one for one in tests.values() if shown(one) and one.chance(_stated(vehicle, one)) <= VETO]


def new_sensor_errors(
    after: Mapping[str, KinematicTest], before: Mapping[str, KinematicTest], vehicle: Vehicle
) -> list[KinematicTest]:
    """Return errors of the velocity sensor that are new in a recording and absent from the file.

    An error that could not be tested in the earlier recording is not new.
    """
    tested = (one for one in unstated(after, vehicle) if one.effect in before)
    return [one for one in tested if _differ(one, before[one.effect])]


def by_kinematics(table: Mapping[str, Any], tests: Mapping[str, KinematicTest]) -> bool:
    """Return whether an effect is an error of the velocity sensor with the values of its kinematic test."""
    test = tests.get(str(table["name"]))
    return test is not None and shown(test) and all(table.get(k) == v for k, v in test.table.items())


def _stated(vehicle: Vehicle, test: KinematicTest) -> Array:
    """Return a file's values of a sensor error as a vector, (p,) for p parameters; zeros by default."""
    for table in vehicle.effects(test.effect):
        values = CATALOGUE[test.effect].pack(table, thrusters=len(vehicle.thruster))
        return np.broadcast_to(values, test.estimate.shape)
    return np.zeros_like(test.estimate)


def _differ(one: KinematicTest, other: KinematicTest) -> bool:
    """Return whether a sensor error differs between two recordings by more than chance.

    The difference must also exceed an amount that does not matter.
    """
    away, spread = one.estimate - other.estimate, one.covariance + other.covariance
    chance = float(scipy.special.chdtrc(len(away), away @ np.linalg.solve(spread, away)))
    return chance <= VETO and bool((np.abs(away) > one.negligible).any())
