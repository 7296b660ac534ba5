"""Wrench that a model lacks: main axis, part of the recording with most of it, and growth with speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro.core.columns import DOF, VELOCITY, Array
from hydro.core.evaluation import failure_regimes
from hydro.core.evaluation.force_error import force
from hydro.core.evaluation.misfit import Misfit
from hydro.core.evaluation.regimes import Pieces, families
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.prediction.candidate import candidate
from hydro.core.recording.arrays import Recording
from hydro.core.vehicle.description import Vehicle

SAME_POWER = 0.3
"""Largest difference of two powers of speed that count as equal; those of known laws differ by 0.5."""
SPEED_BINS = 8
"""Number of speed bins of equal counts, and minimum number of pieces of time in each bin."""


@dataclass(frozen=True)
class Leftover:
    """Wrench that a model lacks: its main axis, the place with most of it, and its growth with speed.

    Attributes:
        axis: Axis with the largest wrench, 0 to 5; None if the residual forces are noise only.
        share: Share of the squared residual that is on this axis.
        name: Name of the axis.
        place: Condition with most of the residual, in words; empty if no condition stands out.
        power: Exponent n in wrench ~ speed^n; None if the data do not show an exponent.
        powers: The same exponent for each velocity u to r alone; None where the data do not show it.
    """

    axis: int | None = None
    share: float = 0.0
    name: str = ""
    place: str = ""
    power: float | None = None
    powers: tuple[float | None, ...] = (None,) * len(VELOCITY)

    def words(self) -> str:
        """Return a phrase with the missing wrench's main axis, its place and its growth with speed."""
        if self.axis is None:
            return "the residual is noise in the forces: check the log's sensors"
        text = f"mostly {self.name} ({self.share:.0%} of it)"
        if self.place:
            text += f", most of it {self.place}"
        if self.power is None:
            return text
        if self.power > SAME_POWER:
            return f"{text}; it grows about as speed to the power {self.power:.1f}"
        return f"{text}; it does not grow with speed"

    def growing(self) -> str:
        """Return a clause on the growth of the wrench with each velocity, the steepest first.

        Empty without growth.
        """
        told = ", ".join(f"{VELOCITY[i]} to the power {self.powers[i]:.1f}" for i in self._steepest())
        return f"; by velocities, it grows with {told}" if told else ""

    def experiment(self) -> str:
        """Return a sentence that proposes an experiment which would show the cause of the missing wrench."""
        if self.axis is None:
            return "check the log with `hydro import`, its units, axes and time stamps"
        grown = self._steepest()
        if grown:
            return (
                f"to identify it, record one velocity at a time, {DOF[grown[0]]} first, at four speeds or "
                "more in both directions, and coast down without thrust after each"
            )
        return (
            f"to identify it, stay without thrust at several headings, tilts and depths, then run each "
            f"thruster alone at several commands, and find which of them causes the error in {DOF[self.axis]}"
        )

    def _steepest(self) -> list[int]:
        """Return the velocities with growth, by number, the steepest growth first."""
        grown = [
            (power, i) for i, power in enumerate(self.powers) if power is not None and power > SAME_POWER
        ]
        return [i for _, i in sorted(grown, reverse=True)]


def leftover(vehicle: Vehicle, record: Recording, sessions: Sequence[str], seed: int = 0) -> Leftover:
    """Return the main axis and place of the wrench that a model lacks, and its growth with speed.

    Args:
        vehicle: Model with all findings of a diagnosis.
        record: Recording.
        sessions: Name of each segment's session.
        seed: Seed of the noise from which the noise floor is computed.
    """
    motion, pieces = Motion.of(record), Pieces.of(record)
    misfit, _, _ = force(candidate(vehicle), record, motion, pieces, seed)
    excess = misfit.weight * (misfit.squares - misfit.noise)
    whole = np.maximum(excess.sum(axis=0), 0.0)
    if not whole.any():
        return Leftover()
    axis = int(whole.argmax())
    found = families(record, vehicle, pieces, motion.eta, motion.nu, motion.nu_dot, sessions)
    places = failure_regimes.rank(excess / whole.sum(), misfit.rows, pieces.block, found)
    there = next((place for place in places if place.axis == axis), None)
    left = _mean(misfit, axis)

    def power(columns: slice) -> float | None:
        speed = np.sqrt(pieces.total((motion.nu[:, columns] ** 2).sum(axis=1)) / misfit.rows)
        return growth(speed, left)

    return Leftover(
        axis,
        float(whole[axis] / whole.sum()),
        misfit.axes[axis],
        there.words if there is not None and there.words != failure_regimes.THROUGHOUT else "",
        power(slice(3)),
        tuple(power(slice(i, i + 1)) for i in range(len(VELOCITY))),
    )


def growth(speed: Array, square: Array) -> float | None:
    """Return the exponent n in force ~ speed^n, fitted to means over bins of speed.

    Args:
        speed: Speed in each of P pieces of time [m/s], (P,).
        square: Mean squared force beyond the noise in each piece, (P,).

    Returns:
        The exponent; None with too few pieces, or if the bins hardly differ in speed.
    """
    if len(speed) < SPEED_BINS**2:
        return None
    order = np.array_split(np.argsort(speed), SPEED_BINS)
    v = np.array([speed[part].mean() for part in order])
    f = np.array([square[part].mean() for part in order])
    seen = (f > 0.0) & (v > 0.0)
    if seen.sum() < 3 or v[seen].max() < 1.5 * v[seen].min():
        return None
    return float(0.5 * np.polyfit(np.log(v[seen]), np.log(f[seen]), 1)[0])


def _mean(misfit: Misfit, axis: int) -> Array:
    """Return the mean squared force beyond the noise in each piece of time on an axis, (P,)."""
    mean: Array = (misfit.squares - misfit.noise)[:, axis] / misfit.rows
    return mean
