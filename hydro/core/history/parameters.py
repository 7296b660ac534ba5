"""Parameters of a vehicle that are followed over its dives.

They are the thrust of each thruster and the drag on each axis, relative to the baseline, and the net
buoyancy. An ocean current is estimated with them in each dive, as a nuisance that is not reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from hydro.core.columns import DOF, Array
from hydro.core.effects.actuator import THRUSTER_GAIN
from hydro.core.effects.changes import in_current
from hydro.core.effects.damping import LINEAR_DAMPING, QUADRATIC_DAMPING
from hydro.core.effects.restoring import NET_BUOYANCY
from hydro.core.prediction.candidate import candidate
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import GAIN

THRUST, BUOYANCY, DRAG, CURRENT = "thrust", "buoyancy", "drag", "current"
"""Kinds of parameters."""
SHARE, NEWTON, SPEED = "1", "N", "m/s"
SPREAD_OF_SHARE = 0.5
"""Prior standard deviation of thrust and drag relative to the baseline [1].

It is wide compared with the changes of interest, so that only a parameter without information in the dive
stays near the baseline.
"""
SPREAD_OF_BUOYANCY = 0.05
"""Prior standard deviation of the net buoyancy as a share of the buoyancy [1]: ballast is trimmed closer."""
SPREAD_OF_CURRENT = 0.5
"""Prior standard deviation of a current [m/s]: tidal currents in which such vehicles work."""
STEP = 0.02
"""Step of a derivative, in prior standard deviations: small against curvature, large against rounding."""
LEAST_SHARE = 1e-3
"""Minimum thrust relative to the baseline during a fit [1]: the gain of a thruster has a lower bound."""


@dataclass(frozen=True)
class Parameter:
    """Parameter of a vehicle that every dive estimates.

    Attributes:
        name: Identifier in tables, such as `thrust_3` or `drag_sway`.
        kind: THRUST, BUOYANCY, DRAG or CURRENT.
        index: Thruster or axis, from 0.
        label: Name in sentences, such as `Thruster 3`, which has the index 2.
        unit: Unit of the values.
        neutral: Value of the unchanged vehicle.
        spread: Prior standard deviation.
    """

    name: str
    kind: str
    index: int
    label: str
    unit: str
    neutral: float
    spread: float

    @property
    def reported(self) -> bool:
        """Whether the parameter belongs to the vehicle, not to the water of one dive as a current does."""
        return self.kind != CURRENT


@dataclass(frozen=True)
class Drag:
    """Drag of the unchanged vehicle on each axis, linear and quadratic in the velocity of the same axis.

    Attributes:
        linear: Linear coefficients, (6,) [N s/m, N m s].
        quadratic: Quadratic coefficients, (6,) [N s^2/m^2, N m s^2].
    """

    linear: Array
    quadratic: Array


def parameters_of(vehicle: Vehicle, drag: Drag) -> tuple[Parameter, ...]:
    """Return the parameters to follow: thrusters, net buoyancy, a current, and drag on axes that have drag.

    Args:
        vehicle: Vehicle file.
        drag: Drag of the unchanged vehicle.
    """
    found = [
        Parameter(f"thrust_{i + 1}", THRUST, i, f"Thruster {i + 1}", SHARE, 1.0, SPREAD_OF_SHARE)
        for i, thruster in enumerate(vehicle.thruster)
        if thruster.pushes
    ]
    spread = SPREAD_OF_BUOYANCY * vehicle.buoyancy.force
    found.append(Parameter(NET_BUOYANCY.name, BUOYANCY, 0, "Net buoyancy", NEWTON, 0.0, spread))
    for axis, name in enumerate(DOF):
        if drag.linear[axis] + drag.quadratic[axis] > 0.0:
            label = f"{name.capitalize()} drag"
            found.append(Parameter(f"drag_{name}", DRAG, axis, label, SHARE, 1.0, SPREAD_OF_SHARE))
    for axis, name in enumerate(("north", "east")):
        label = f"Current to the {name}"
        found.append(Parameter(f"current_{name}", CURRENT, axis, label, SPEED, 0.0, SPREAD_OF_CURRENT))
    return tuple(found)


def vehicle_at(vehicle: Vehicle, drag: Drag, parameters: Sequence[Parameter], values: Array) -> Vehicle:
    """Return a copy of a vehicle with given parameter values, as effects added to those of its file.

    Args:
        vehicle: Vehicle file.
        drag: Drag of the unchanged vehicle, which drag parameters scale.
        parameters: The P parameters.
        values: Values of the parameters, (P,).
    """
    gains, linear, quadratic, current = (np.zeros(len(vehicle.thruster)), *np.zeros((3, 6)))
    given, lift = 1.0 + candidate(vehicle).thrusters[:, GAIN], 0.0
    for parameter, value in zip(parameters, values, strict=True):
        i = parameter.index
        if parameter.kind == THRUST:
            gains[i] = (max(value, LEAST_SHARE) - 1.0) * given[i]
        elif parameter.kind == BUOYANCY:
            lift = float(value)
        elif parameter.kind == DRAG:
            linear[i] = (value - 1.0) * drag.linear[i]
            quadratic[i] = (value - 1.0) * drag.quadratic[i]
        else:
            current[i] = value
    added = (
        {"name": THRUSTER_GAIN.name, "g": gains.tolist()},
        {"name": NET_BUOYANCY.name, "dB": lift},
        {"name": LINEAR_DAMPING.name, "diagonal": linear.tolist()},
        {"name": QUADRATIC_DAMPING.name, "diagonal": quadratic.tolist()},
    )
    return in_current(msgspec.structs.replace(vehicle, effect=(*vehicle.effect, *added)), current[:3])


def named(vehicle: Vehicle, names: Sequence[str]) -> tuple[Parameter, ...]:
    """Return parameters of a vehicle by name, such as those of a stored history.

    Args:
        vehicle: Vehicle file.
        names: Names such as `thrust_3` or `drag_sway`.

    Raises:
        KeyError: The vehicle has no parameter of a name.
    """
    every = Drag(np.ones(6), np.ones(6))
    known = {one.name: one for one in parameters_of(vehicle, every)}
    return tuple(known[name] for name in names)
