"""Equations of motion on plain lists of numbers, for export as source and for symbolic tracing.

They repeat `simulation.dynamics` and `simulation.integrate` without numba and numpy, around the same kernels
of the catalogue.  `export.source` writes them into a file with all functions that they call; `export.tracing`
runs them on symbols.  They never run on numbers within hydro, whose kernels take arrays.
"""

from __future__ import annotations

import math
from typing import Any

from hydro.core.effects.layout import (
    BALANCE,
    COMMANDS,
    INVERSE_MASS_MATRIX,
    MASS_MATRIX,
    MOST_COMMANDS,
    MOTION,
    POSITION,
    RELATIVE_VELOCITY,
    ROTATION,
    TIME,
    VELOCITY,
)
from hydro.core.effects.program import HEADER, relative_to_water
from hydro.core.simulation.dynamics import BODY, thrust_of
from hydro.core.vehicle.frames import quaternion_kernel
from hydro.core.vehicle.rigid_body import coriolis_kernel, restoring_kernel
from hydro.core.vehicle.thrusters import DELAY, POWER, lag_decay, settled_state

Numbers = Any
"""List of floats, or of symbols for them; kernels written for arrays accept it too."""


def interpolated(at: float, points: Numbers, values: Numbers) -> float:
    """Return the value at an abscissa, interpolated linearly between points and constant beyond them.

    Args:
        at: Abscissa of the result.
        points: Abscissae in ascending order.
        values: Values at these points.
    """
    if at <= points[0]:
        return float(values[0])
    for k in range(1, len(points)):
        if at <= points[k]:
            share = (at - points[k - 1]) / (points[k] - points[k - 1])
            return float(values[k - 1] + share * (values[k] - values[k - 1]))
    return float(values[-1])


def effective(thruster: Numbers, curve: Any, command: Any) -> Any:
    """Return the effective command of a thruster with a thrust table.

    With the simple thrust curve, the effective command gives the thrust that the table gives for the original
    command.

    Args:
        thruster: Row of the thruster table, for the exponent of the simple curve.
        curve: Commands, thrusts [N] and full thrust ahead and astern [N] of its thrust table; None without
            a table, where the command itself is returned.
        command: Command in [-1, 1].
    """
    if curve is None:
        return command
    commands, thrusts, ahead, astern = curve
    thrust = interpolated(command, commands, thrusts)
    share = thrust / ahead if thrust > 0.0 else thrust / astern
    if thruster[POWER] == 1.0:
        return share
    return math.copysign(math.pow(abs(share), 1.0 / thruster[POWER]), share)


class Model:
    """Vehicle as plain numbers and functions (kernels), without arrays.

    Attributes:
        flat: Header and constants of the vehicle's program, which the kernels read.
        thrusters: Rows of the thruster table.
        curves: For each thruster commands, thrusts [N] and full thrust ahead and astern [N]; None without a
            thrust table.
        effects: For each effect with a force its kernel, the kernel that initialises its states or None, its
            parameters and the number of its states.
    """

    def __init__(self, flat: Numbers, thrusters: Numbers, curves: Numbers, effects: Numbers) -> None:
        self.flat = flat
        self.thrusters = thrusters
        self.curves = curves
        self.effects = effects


def targets(model: Model, commands: Numbers) -> Numbers:
    """Return the values that the lag states of the thrusters approach under constant commands.

    A lag state is the thrust before losses [N], or the rotor speed as a share of full speed.

    Args:
        model: Vehicle.
        commands: Commands in [-1, 1], one per thruster.
    """
    found = []
    for i in range(len(model.thrusters)):
        command = effective(model.thrusters[i], model.curves[i], commands[i])
        found.append(settled_state(model.thrusters[i], command))
    return found


def motion_state(model: Model, y: Numbers, time: float, commands: Numbers) -> Numbers:
    """Return the state of motion in the layout that the kernels read (`core.effects.layout`).

    Args:
        model: Vehicle.
        y: Position [m] and quaternion w x y z in NED, velocity nu in FRD [m/s, rad/s], internal states.
        time: Time [s].
        commands: Commands in [-1, 1], one per thruster.
    """
    s: Numbers = [0.0] * MOTION
    turned: Numbers = [0.0] * 9
    quaternion_kernel(y[3:7], turned)
    for i in range(9):
        s[ROTATION + i] = turned[i]
    for i in range(3):
        s[POSITION + i] = y[i]
    for i in range(6):
        s[VELOCITY + i] = y[7 + i]
    s[TIME] = time
    for i in range(min(len(commands), MOST_COMMANDS)):
        s[COMMANDS + i] = effective(model.thrusters[i], model.curves[i], commands[i])
    relative_to_water(model.flat, s)
    return s


def initial_states(model: Model, y: Numbers, time: float) -> Numbers:
    """Return the initial internal states of the effects, as if the velocity had always been constant.

    Args:
        model: Vehicle.
        y: State as for `motion_state`; its internal states are ignored.
        time: Time [s].
    """
    s, found = motion_state(model, y, time, []), []
    for _, start, parameters, count in model.effects:
        states = [0.0] * count
        if start is not None:
            start(parameters, model.flat[HEADER:], s, states)
        for value in states:
            found.append(value)
    return found


def rates(model: Model, y: Numbers, time: float, rotors: Numbers, commands: Numbers) -> Numbers:
    """Return the time derivative of the state, in the order of `y`.

    Fossen (2011), eq. 7.190 and section 2.2.2.

    Args:
        model: Vehicle.
        y: State as for `motion_state`.
        time: Time [s].
        rotors: Lag states of the thrusters at this time, as defined for `targets`.
        commands: Commands in [-1, 1], one per thruster.
    """
    c = model.flat[HEADER:]
    s = motion_state(model, y, time, commands)
    nu_r = s[RELATIVE_VELOCITY : RELATIVE_VELOCITY + 6]
    tau: Numbers = [0.0] * 6
    for i in range(len(model.thrusters)):
        thrust = thrust_of(model.thrusters[i], rotors[i], s)
        for j in range(6):
            tau[j] += model.thrusters[i][j] * thrust
    restoring_kernel(c[BALANCE : BALANCE + 4], s[ROTATION + 6 : ROTATION + 9], tau)
    changes, at = [], BODY
    for kernel, _, parameters, count in model.effects:
        change = [0.0] * count
        kernel(parameters, c, s, y[at : at + count], change, tau)
        for value in change:
            changes.append(value)
        at += count
    turning: Numbers = [0.0] * 6
    coriolis_kernel(c[MASS_MATRIX : MASS_MATRIX + 36], nu_r, turning)
    nu_dot = [0.0] * 6
    for i in range(6):
        for j in range(6):
            nu_dot[i] += c[INVERSE_MASS_MATRIX + 6 * i + j] * (tau[j] - turning[j])
    u, v, w, p, q, r = y[7], y[8], y[9], y[10], y[11], y[12]
    # The current is constant in the world, so it rotates in the body.
    x_c, y_c, z_c = u - nu_r[0], v - nu_r[1], w - nu_r[2]
    nu_dot[0] -= q * z_c - r * y_c
    nu_dot[1] -= r * x_c - p * z_c
    nu_dot[2] -= p * y_c - q * x_c
    found = []
    for i in range(3):
        row = ROTATION + 3 * i
        found.append(s[row] * u + s[row + 1] * v + s[row + 2] * w)
    found.append(-0.5 * (y[4] * p + y[5] * q + y[6] * r))
    found.append(0.5 * (y[3] * p - y[6] * q + y[5] * r))
    found.append(0.5 * (y[6] * p + y[3] * q - y[4] * r))
    found.append(0.5 * (-y[5] * p + y[4] * q + y[3] * r))
    return found + nu_dot + changes


def normalised(y: Numbers) -> Numbers:
    """Return a state (as for `motion_state`) with its quaternion scaled to unit length."""
    norm = math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5] + y[6] * y[6])
    return y[:3] + [y[i] / norm for i in range(3, 7)] + y[7:]


def runge_kutta(model: Model, y: Numbers, time: float, h: float, lags: Numbers, commands: Numbers) -> Numbers:
    """Return the state after one classical Runge-Kutta step.

    Args:
        model: Vehicle.
        y: State as for `motion_state`.
        time: Time at the start of the step [s].
        h: Length of the step [s].
        lags: Lag states of the thrusters at the start, the middle and the end of the step.
        commands: Commands in [-1, 1], one per thruster.
    """
    size = range(len(y))
    a = rates(model, y, time, lags[0], commands)
    b = rates(model, [y[i] + 0.5 * h * a[i] for i in size], time + 0.5 * h, lags[1], commands)
    c = rates(model, [y[i] + 0.5 * h * b[i] for i in size], time + 0.5 * h, lags[1], commands)
    d = rates(model, [y[i] + h * c[i] for i in size], time + h, lags[2], commands)
    return normalised([y[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]) for i in size])


def lag_after(thruster: Numbers, state: float, target: float, dt: float) -> float:
    """Return the lag state of a thruster after `dt` [s] of first-order approach to a constant target.

    Args:
        thruster: Row of the thruster table, with the time constant.
        state: Lag state at the start.
        target: Value that the state approaches.
        dt: Time [s].
    """
    return float(target + (state - target) * lag_decay(thruster, dt))


class Commands:
    """Memory of commands, from which each thruster reads with its own delay.

    Attributes:
        given: Times [s] and commands, in the order in which they were given.
    """

    def __init__(self) -> None:
        self.given: list[tuple[float, Numbers]] = []

    def give(self, time: float, commands: Numbers) -> None:
        """Add commands, one per thruster, that are given from `time` [s] on."""
        self.given.append((time, commands))

    def delayed(self, model: Model, now: float) -> Numbers:
        """Return the command of each thruster that acts at the time `now` [s]; 0 before the first command."""
        found = [0.0] * len(model.thrusters)
        for time, commands in self.given:
            for i in range(len(found)):
                if time + model.thrusters[i][DELAY] <= now:
                    found[i] = commands[i]
        return found

    def next_change(self, model: Model, now: float, end: float) -> float:
        """Return the next time [s] at which a delayed command takes effect, at most `end`.

        Commands that no thruster uses any more are dropped.

        Args:
            model: Vehicle, with the thrusters' delays.
            now: Present time [s].
            end: Greatest time returned [s].
        """
        latest = max([row[DELAY] for row in model.thrusters] + [0.0])
        while len(self.given) > 1 and self.given[1][0] + latest <= now:
            self.given.pop(0)
        for time, _ in self.given:
            for row in model.thrusters:
                if now < time + row[DELAY] < end:
                    end = time + row[DELAY]
        return end
