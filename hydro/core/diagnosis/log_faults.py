"""Preprocessed log, and the faults that were found in it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import polars as pl

from hydro.core.audit.thrusters import CLEARLY, ThrusterAudit, audit
from hydro.core.audit.wiring import Wiring
from hydro.core.cleaning.cleaned import Cleaned, cleaned, heavy_tails_told
from hydro.core.columns import Array, command_column
from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.model import unfitted
from hydro.core.diagnosis.settings import MOST_SHOTS
from hydro.core.errors import DataError
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import LONGEST_SENSOR_DELAY
from hydro.core.prediction.tracking import tracked
from hydro.core.preprocessing.late_velocities import lateness, on_time
from hydro.core.preprocessing.sensor_tests import KinematicTest, kinematic_tests
from hydro.core.recording.arrays import Recording, noise, recording
from hydro.core.recording.heavy_tails import Tail
from hydro.core.recording.shots import SHOT_SECONDS, Shots, make_shots
from hydro.core.residual.hull import Hull
from hydro.core.residual.response import Transitions
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Preprocessed:
    """Recording without the faults of its log, with the quantities that all vehicles need of it.

    Attributes:
        raw: Raw table.
        record: Recording as arrays.
        faults: One finding for each kind of fault.
        wiring: Order and signs of the command columns if they differ from the vehicle file's; None otherwise.
        tails: Noise of channels with heavy tails.
        sampled: Recording before a motion model filled the gaps between samples of slow sensors; None where
            it is `record`.
        audit: Thruster audit of the original columns; None of a recording too short for it.
    """

    raw: pl.DataFrame
    record: Recording
    faults: tuple[Finding, ...]
    wiring: Wiring | None = None
    tails: tuple[Tail, ...] = ()
    sampled: Recording | None = None
    audit: ThrusterAudit | None = None
    _shots: dict[float, Shots] = field(default_factory=dict, init=False, repr=False)

    @property
    def changes(self) -> tuple[str, ...]:
        """One sentence for each change made to the log."""
        return (*(fault.advice for fault in self.faults), *heavy_tails_told(self.tails))

    @property
    def observed(self) -> Recording:
        """Recording without values that a motion model estimated between samples of a slow sensor."""
        return self.record if self.sampled is None else self.sampled

    @property
    def misdirected(self) -> bool:
        """Whether the audit is certain that directions or order of the thrusters differ from the file."""
        return self.audit is not None and self.audit.wrong

    def require_directions(self, file: str = "") -> None:
        """Refuse a recording that contradicts the directions or the order of the file's thrusters.

        Raises:
            DataError: The recording contradicts them; the message says how to correct the file.
        """
        if self.audit is not None and self.audit.wrong:
            raise DataError(f"{self.audit.headline(file)}; or continue as it is with --correct-thrusters")

    def as_audited(self) -> Preprocessed:
        """Return a copy without the audit: command columns, as the audit corrected them, count as right."""
        return replace(self, audit=None)

    def audited(self, found: ThrusterAudit | None) -> Preprocessed:
        """Return a copy with a thruster audit, and with the sensor tests and shots already computed.

        `found` is None if the recording is too short for an audit.
        """
        whole = replace(self, audit=found)
        vars(whole).update({name: vars(self)[name] for name in ("sensors", "lateness") if name in vars(self)})
        whole._shots.update(self._shots)
        return whole

    @property
    def track(self) -> Array:
        """Positions [m] and times [s] along the recording, (N, 4)."""
        return self.record.track

    @property
    def sessions(self) -> list[str]:
        """Name of the session of each of S segments without a gap, (S,)."""
        return [str(name) for name in self.raw["session"].gather(self.record.segments[:, 0])]

    @property
    def middle(self) -> Array:
        """Start pose of a next manoeuvre, (6,) [m, rad]: the median position, level, heading north."""
        pose: Array = np.median(self.record.eta, axis=0) * [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
        return pose

    @cached_property
    def noise(self) -> Array:
        """Standard deviation of the white noise of pose and velocity, (12,) [m, rad, m/s, rad/s]."""
        return noise(self.record)

    @cached_property
    def motion(self) -> Motion | None:
        """Smoothed motion of the recording; None if it is too short to be smoothed."""
        with suppress(DataError):
            return Motion.of(self.record)
        return None

    @cached_property
    def sensors(self) -> dict[str, KinematicTest]:
        """Kinematic tests of velocity sensor errors, by effect."""
        return kinematic_tests(self.record)

    @cached_property
    def lateness(self) -> float:
        """Delay of the velocity sensor [s]; 0 unless kinematics shows one."""
        return lateness(lambda: self.sensors)

    def shots(self, seconds: float) -> Shots:
        """Return shots of a length [s], starting at the smoothed measured states.

        Where kinematics shows a delay of the velocity sensor, they start earlier by the greatest delay,
        because the first samples show motion from before the shot.

        Raises:
            DataError: No segment is as long as one shot.
        """
        if seconds not in self._shots:
            lead = LONGEST_SENSOR_DELAY if self.lateness > 0.0 else 0.0
            self._shots[seconds] = make_shots(
                self.record, seconds=seconds, lead=lead, sigma=self.noise, most=MOST_SHOTS
            )
        return self._shots[seconds]


def preprocess(vehicle: Vehicle, raw: pl.DataFrame, hull: Hull | None = None) -> Preprocessed:
    """Return a recording cleaned, with its command columns in the order that the accelerations require.

    Args:
        vehicle: Vehicle file.
        raw: Raw table.
        hull: Hull-force model learnt from an earlier recording.  Its force is subtracted from the
            accelerations, where it would hide a different order of the commands, if it adds to the file.

    Raises:
        DataError: The recording does not fit the vehicle.
    """
    log = cleaned(vehicle, raw)
    plain = _ordered(vehicle, log, None)
    timely = on_time(log.record, plain.lateness)
    beside = None
    if hull is not None and hull.completion is None:  # else the force adds to the fitted file
        beside = _beside(vehicle, plain, hull)
    found = audit(vehicle, timely, beside=beside)
    if found is None or not found.wrong:
        return plain.audited(found)
    ordered = _ordered(vehicle, log, found.wiring)
    if _contradicted(vehicle, ordered, plain, hull):
        return plain.audited(replace(found, contradicted=True))
    misdirected = Finding(
        "log_fault", members=found.columns(), confidence=found.probability, advice=found.headline()
    )
    return replace(
        ordered,
        faults=(misdirected, *ordered.faults),
        wiring=None if found.wiring.is_plain else found.wiring,
        audit=found,
    )


def preprocess_alike(vehicle: Vehicle, raw: pl.DataFrame, wiring: Wiring | None) -> Preprocessed:
    """Return another recording cleaned, with the order of commands that was found in a first one.

    Raises:
        DataError: The recording does not fit the vehicle.
    """
    return _ordered(vehicle, cleaned(vehicle, raw), wiring)


def _ordered(vehicle: Vehicle, log: Cleaned, wiring: Wiring | None) -> Preprocessed:
    """Return a cleaned recording with its commands in the vehicle file's order."""
    raw, record = log.raw, log.record
    if wiring is not None:
        raw = in_order(raw, wiring)
        record = replace(record, commands=recording(vehicle, raw).commands)
    faults = tuple(Finding("log_fault", members=one.columns, advice=one.message) for one in log.faults)
    return Preprocessed(raw, tracked(vehicle, record), faults, tails=log.tails, sampled=record)


def in_order(raw: pl.DataFrame, wiring: Wiring) -> pl.DataFrame:
    """Return the table with its command columns in the order and with the signs of the vehicle file."""
    return raw.with_columns(
        (sign * pl.col(command_column(column))).alias(command_column(i))
        for i, (column, sign) in enumerate(wiring.drives())
    )


def _beside(vehicle: Vehicle, log: Preprocessed, hull: Hull) -> Array | None:
    """Return the hull force that the file lacks at N rows, (N, 6) [N, N m]; None if the log is too short."""
    try:
        return hull.law.wrench(vehicle, log.shots(SHOT_SECONDS))
    except DataError:
        return None


def _contradicted(vehicle: Vehicle, ordered: Preprocessed, plain: Preprocessed, hull: Hull | None) -> bool:
    """Return whether most predictions of a recording contradict another order of the commands.

    The audit compares accelerations at one time, where missing forces or the error of a hull-force model can
    look like an exchange of two thrusters.  Predictions can contradict it, because exchanged columns drive
    the vehicle elsewhere.  With a hull-force model, the other order must predict most shots better.  A file
    alone may predict badly with any order, so the other one must then predict most shots CLEARLY worse.
    Without a gap-free stretch for a prediction, the audit alone decides.
    """
    try:
        given, other = (_costs(vehicle, one, hull) for one in (plain, ordered))
    except DataError:
        return False
    if hull is not None:
        return not (other < given).sum() > (given < other).sum()
    return bool((other > CLEARLY * given).sum() > (other < CLEARLY * given).sum())


def _costs(vehicle: Vehicle, log: Preprocessed, hull: Hull | None) -> Array:
    """Return the squared residual of each of S predictions, with the hull-force model if there is one, (S,).

    They are half as long as those of a fit: within two seconds, an undamped file turns over with any order.
    """
    shots = log.shots(SHOT_SECONDS / 2.0)
    if hull is None:
        return unfitted(vehicle, OutputError.of(shots, vehicle)).costs
    vehicle = hull.completed(vehicle)
    return unfitted(vehicle, hull.acting(vehicle, Transitions.of(candidate(vehicle), shots))).costs
