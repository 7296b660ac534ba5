"""Output error over shots (short predictions) in which a known wrench acts on every predicted vehicle.

Six more thrusters without lag, one per axis, produce the wrench.  Their commands are appended to the
vehicle's commands in the recording.  So the wrench acts along the predicted motion, however far a vehicle
without the wrench would go.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from hydro.core.columns import Array
from hydro.core.prediction import multiple_shooting
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.multiple_shooting import Prepared
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.shots import CHANNELS, Shots
from hydro.core.simulation.dynamics import BODY
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import COLUMNS, MAX_REVERSE, MAX_THRUST, POWER, UNIT_WRENCH

AXES = 6


@dataclass(frozen=True)
class ForcedOutputError(OutputError):
    """Output-error problem in which a known wrench acts in addition to the vehicle's forces.

    Attributes:
        rows: Six rows of the thruster table, (6, COLUMNS), for the thrusters that produce the wrench.
    """

    rows: Array = field(default_factory=lambda: np.zeros((0, COLUMNS)))

    @classmethod
    def under(cls, shots: Shots, wrench: Array) -> ForcedOutputError:
        """Return the output-error problem of shots (short predictions) in which a known wrench acts.

        Args:
            shots: Shots of a recording.
            wrench: Wrench at every row of the recording, about CO in body axes, (N, 6) [N, N m].
        """
        between = wrench.copy()
        between[:-1] = 0.5 * (wrench[:-1] + wrench[1:])  # a command acts until the next row
        limits = np.maximum(np.abs(between).max(axis=0), 1.0)
        rows = np.zeros((AXES, COLUMNS))
        rows[:, UNIT_WRENCH] = np.eye(AXES)
        rows[:, MAX_THRUST] = rows[:, MAX_REVERSE] = limits
        rows[:, POWER] = 1.0
        commands = np.ascontiguousarray(np.hstack([shots.record.commands, between / limits]))
        return cls(replace(shots, record=replace(shots.record, commands=commands)), rows=rows)

    def prepared(self, vehicle: Vehicle, like: Prepared | None = None) -> Prepared:
        """Return a compiled vehicle that the wrench acts on, with its initial states in every shot.

        The initial states are those of the rotors and of the effects.

        Args:
            vehicle: The vehicle.
            like: Another vehicle prepared for the same shots; its states are reused where they are the same.
        """
        return multiple_shooting.prepare(candidate(vehicle).with_thrusters(self.rows), self.shots, like)

    def of_measured(self, measured: Array) -> ForcedOutputError:
        """Return a copy of the problem with other measurements in the place of the logged ones.

        Args:
            measured: Position, quaternion and nu in each row of the S shots, (S, length, 13).
        """
        return replace(self, shots=replace(self.shots, measured=measured))


def displaced_by(measured: Array, one: Array, other: Array) -> Array:
    """Return a copy of the measurements, moved by the difference of two predictions, (S, length, 13).

    Measurements of a shot with a diverging prediction stay as they are.

    Args:
        measured: Measurements in S shots: position, quaternion and nu, (S, length, 13).
        one: First prediction, (S, length, 13).
        other: Second prediction, which is subtracted from the first, (S, length, 13).
    """
    answer = np.empty((*measured.shape[:2], CHANNELS))
    multiple_shooting.deviate(other, one, 0, np.ones(CHANNELS), answer)
    answer[~(np.abs(answer) < multiple_shooting.WILD).all(axis=(1, 2))] = 0.0
    flat = multiple_shooting.displaced(measured.reshape(-1, BODY), answer.reshape(-1, CHANNELS))
    return np.asarray(flat.reshape(measured.shape))
