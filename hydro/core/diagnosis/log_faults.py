"""A log preprocessed before anything is fitted to it, and what was wrong with it, for the user."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import polars as pl

from hydro.core.audit.thrusters import ThrusterAudit, audit
from hydro.core.audit.wiring import Wiring
from hydro.core.columns import Array, command_column
from hydro.core.diagnosis.findings import Finding
from hydro.core.errors import DataError
from hydro.core.logs.axis_faults import axis_faults
from hydro.core.prediction.tracking import tracked
from hydro.core.preprocessing.sensor_tests import KinematicTest, kinematic_tests
from hydro.core.recording.arrays import Recording, noise, recording
from hydro.core.recording.sensor_faults import (
    Corrected,
    without_bad_readings,
    without_bias,
    without_faults,
    without_outliers,
)
from hydro.core.recording.shots import SHOT_SECONDS, Shots, make_shots
from hydro.core.residual.hull import Hull
from hydro.core.vehicle.description import Vehicle

MOST_SHOTS = 600


@dataclass(frozen=True)
class Preprocessed:
    """A recording without the faults of its log; what all vehicles need of it is worked out once.

    Attributes:
        raw: Raw table.
        record: The same as arrays.
        faults: A finding for each kind of fault.
        wiring: The order of the command columns, where it is another than the vehicle file's.
        audit: Audit of the thrusters, before anything was put in order; None of a recording too short for it.
    """

    raw: pl.DataFrame
    record: Recording
    faults: tuple[Finding, ...]
    wiring: Wiring | None = None
    audit: ThrusterAudit | None = None
    _shots: dict[float, Shots] = field(default_factory=dict, init=False, repr=False)

    @property
    def misdirected(self) -> bool:
        """Whether directions or order of the thrusters differ from the file."""
        return self.audit is not None and self.audit.wrong

    def require_directions(self) -> None:
        """Refuse a recording that contradicts the directions or the order of the file's thrusters.

        Raises:
            DataError: It does; the line says how to mend it.
        """
        if self.audit is not None and self.audit.wrong:
            raise DataError(f"{self.audit.headline()}; or go on as it is with --correct-thrusters")

    @property
    def track(self) -> Array:
        """Positions [m] and times [s] along the recording, (N, 4)."""
        return self.record.track

    @property
    def sessions(self) -> list[str]:
        """Name of each segment's session, (S,)."""
        return [str(name) for name in self.raw["session"].gather(self.record.segments[:, 0])]

    @property
    def middle(self) -> Array:
        """Where a next manoeuvre would begin: amid the recording, level, (6,)."""
        pose: Array = np.median(self.record.eta, axis=0) * [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
        return pose

    @cached_property
    def noise(self) -> Array:
        """Standard deviation of the white noise on each channel, pose then velocity, (12,)."""
        return noise(self.record)

    @cached_property
    def sensors(self) -> dict[str, KinematicTest]:
        """What kinematics alone says of the velocity log's errors, by effect."""
        return kinematic_tests(self.record)

    def shots(self, seconds: float) -> Shots:
        """Shots of a length [s], begun where the smoothed log saw the vehicle.

        Raises:
            DataError: No segment is as long as one shot.
        """
        if seconds not in self._shots:
            self._shots[seconds] = make_shots(self.record, seconds=seconds, sigma=self.noise, most=MOST_SHOTS)
        return self._shots[seconds]


def preprocess(vehicle: Vehicle, raw: pl.DataFrame, hull: Hull | None = None) -> Preprocessed:
    """The recording without readings that no motion makes, its commands as the accelerations ask for them.

    Args:
        vehicle: The vehicle.
        raw: Raw table.
        hull: What a recording before has taught: what the hull does beside its file is taken out of the
            accelerations, where it would hide another order of the commands.

    Raises:
        DataError: The recording does not fit the vehicle.
    """
    log = sound(vehicle, raw)
    faults = tuple(Finding("log_fault", members=one.columns, advice=one.message) for one in log.faults)
    plain = Preprocessed(log.raw, tracked(vehicle, log.record), faults)
    found = audit(vehicle, log.record, beside=None if hull is None else _beside(vehicle, plain, hull))
    if found is None or not found.wrong:
        return replace(plain, audit=found)
    raw = in_order(log.raw, found.wiring)
    record = replace(recording(vehicle, raw), sigma=log.record.sigma)
    wiring = None if found.wiring.is_plain else found.wiring
    return Preprocessed(raw, tracked(vehicle, record), (*faults, _misdirected(found)), wiring, found)


def sound(vehicle: Vehicle, raw: pl.DataFrame) -> Corrected:
    """The recording with columns that mean what they are called, without readings that no motion makes.

    Args:
        vehicle: The vehicle.
        raw: Raw table.

    Raises:
        DataError: The recording does not fit the vehicle, or columns contradict each other and it does not
            show which is wrong.
    """
    readings = without_bad_readings(vehicle, raw)
    found = axis_faults(readings.raw, readings.record)
    if found is None:
        return without_outliers(vehicle, without_bias(vehicle, readings))
    log = without_faults(vehicle, found.put_right(raw))
    return replace(log, faults=(*found.faults, *log.faults))


def in_order(raw: pl.DataFrame, wiring: Wiring | None) -> pl.DataFrame:
    """The table with its command columns in the order that the vehicle file means."""
    if wiring is None:
        return raw
    return raw.with_columns(
        (sign * pl.col(command_column(column))).alias(command_column(i))
        for i, (column, sign) in enumerate(wiring.drives())
    )


def _beside(vehicle: Vehicle, log: Preprocessed, hull: Hull) -> Array | None:
    """What the hull does beside the file at every row, (N, 6) [N, N m]; None of a log that is too short."""
    try:
        return hull.law.wrench(vehicle, log.shots(SHOT_SECONDS))
    except DataError:
        return None


def _misdirected(found: ThrusterAudit) -> Finding:
    """Return the finding that directions or order of the thrusters differ from the file."""
    return Finding(
        "log_fault", members=found.columns(), confidence=found.probability, advice=found.headline()
    )
