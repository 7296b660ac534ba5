"""Vehicle class after Fossen's Python Vehicle Simulator, on plain lists; an export writes out its source."""

from __future__ import annotations

import math
from typing import Any

from hydro.core.simulation.dynamics import BODY
from hydro.export.equations import Commands, Model, Numbers, initial_states, lag_after, runge_kutta, targets


def quaternion(phi: float, theta: float, psi: float) -> Numbers:
    """Return the unit quaternion (w, x, y, z) of ZYX Euler angles [rad]; Fossen (2011), section 2.2.3."""
    c1, s1 = math.cos(0.5 * phi), math.sin(0.5 * phi)
    c2, s2 = math.cos(0.5 * theta), math.sin(0.5 * theta)
    c3, s3 = math.cos(0.5 * psi), math.sin(0.5 * psi)
    return [
        c1 * c2 * c3 + s1 * s2 * s3,
        s1 * c2 * c3 - c1 * s2 * s3,
        c1 * s2 * c3 + s1 * c2 * s3,
        c1 * c2 * s3 - s1 * s2 * c3,
    ]


def euler_angles(q: Numbers) -> Numbers:
    """Return the ZYX Euler angles [rad] of a unit quaternion (w, x, y, z)."""
    w, x, y, z = q
    sine = max(-1.0, min(1.0, 2.0 * (w * y - x * z)))
    return [
        math.atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(sine),
        math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)),
    ]


def same_type(given: Any, values: Numbers) -> Any:
    """Return numbers as a float array if `given` is an array, otherwise as the list `values` itself."""
    if not hasattr(given, "astype"):
        return values
    out = given.astype(float)
    out[:] = values
    return out


class Craft:
    """Vehicle with the interface of Fossen's Python Vehicle Simulator.

    eta is x y z [m, NED] and phi theta psi [rad, ZYX].  nu is u v w [m/s] and p q r [rad/s] of the body
    origin over ground, body axes forward, right, down.  `u_control` are commands in [-1, 1], one per
    thruster; `u_actual` are their lag states: thrusts [N], or normalised rotor speeds.

    Attributes:
        nu: Initial velocity, (6,).
        u_actual: Initial lag states, all 0.
        dimU: Number of commands.
        controls: Names of the commands.
        time: Time since `reset` [s]; varying currents and delayed commands depend on it.
        rate: Least number of integration steps per second [Hz].
    """

    name = ""
    controls: tuple[str, ...] = ()
    model = Model([], [], [], [])
    rate = 500.0
    controlMode = "stepInput"
    controlDescription = "Commands of the thrusters"

    def __init__(self) -> None:
        self.nu: Any = [0.0] * 6
        self.u_actual: Any = [0.0] * len(self.controls)
        self.dimU = len(self.controls)
        self.reset()

    def reset(self, time: float = 0.0) -> None:
        """Delete delayed commands and the internal states of effects."""
        self.time = time
        self.states: Numbers | None = None
        self.commands = Commands()

    def stepInput(self, t: float) -> Any:
        """Return the commands at a time [s], here all 0; replace this method to control the vehicle."""
        return [0.0] * self.dimU

    def dynamics(self, eta: Any, nu: Any, u_actual: Any, u_control: Any, sampleTime: float) -> Any:
        """Return velocity and lag states after `sampleTime` [s], as the simulator's main loop expects."""
        _, after, lagging = self.step(eta, nu, u_actual, u_control, sampleTime)
        return after, lagging

    def step(self, eta: Any, nu: Any, u_actual: Any, u_control: Any, sampleTime: float) -> Any:
        """Return pose, velocity and lag states after `sampleTime` [s], by Runge-Kutta steps.

        A step ends when a delayed command takes effect.
        """
        y = [float(value) for value in eta[:3]] + quaternion(eta[3], eta[4], eta[5])
        y += [float(value) for value in nu]
        if self.states is None:
            self.states = initial_states(self.model, y, self.time)
        y += self.states
        given = [float(value) for value in u_control]
        self.commands.give(self.time, given)
        lags, begin = [float(value) for value in u_actual], self.time
        steps = max(1, math.ceil(sampleTime * self.rate * (1.0 - 1e-9)))
        for k in range(steps):
            end = begin + (k + 1) * sampleTime / steps
            close = 1e-9 * sampleTime / steps
            while self.time < end - close:
                until = self.commands.next_change(self.model, self.time + close, end - close)
                until = end if until >= end - close else until
                y, lags = self._advance(y, lags, given, until - self.time)
                self.time = until
        self.states = y[BODY:]
        pose = y[:3] + euler_angles(y[3:7])
        return same_type(eta, pose), same_type(nu, y[7:BODY]), same_type(u_actual, lags)

    def _advance(self, y: Numbers, lags: Numbers, given: Numbers, h: float) -> Any:
        """Return state and lag states after a step of `h` [s] in which the delayed commands are constant.

        Args:
            y: Position, quaternion, velocity and internal states, as for `export.equations.motion_state`.
            lags: Lag states of the thrusters.
            given: Commands in [-1, 1].
            h: Length of the step [s].
        """
        model, delayed = self.model, self.commands.delayed(self.model, self.time + 1e-9 * h)
        goals, rows = targets(model, delayed), range(len(lags))
        middle = [lag_after(model.thrusters[i], lags[i], goals[i], 0.5 * h) for i in rows]
        after = [lag_after(model.thrusters[i], middle[i], goals[i], 0.5 * h) for i in rows]
        first = [lag_after(model.thrusters[i], lags[i], goals[i], 0.0) for i in rows]
        return runge_kutta(model, y, self.time, h, [first, middle, after], given), after
