"""Thrusters: commands in [-1, 1] through delay, dead band, curve and lag to thrusts f, and tau_prop = B f.

One set of scalar kernels serves the columns of a log, the forward simulation and MuJoCo.  A thruster is one
row of `thruster_table`.  Each thruster has one lag state: its thrust [N] before losses (`lag = "thrust"`) or
its normalised rotor speed (`lag = "speed"`).  The state depends on the commands alone, never on the motion;
losses that depend on the motion (inflow) follow in `state_to_thrust`.

A thruster whose curve is a table has *effective* commands here: the commands that give the same thrust by a
simple curve (linear or quadratic).  `recording.supply` computes them from the commands and the supply voltage
of a recording, once, before any integration.  For all other thrusters they are the commands.

A command logged in row k acts on [t_k, t_k+1).  A value at t_k is the limit from the left: the state at the
first row is the initial state, and the first command first acts at the second row.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.compiled import jit, kernel
from hydro.core.errors import DataError
from hydro.core.thrust_curves.curve import curve_table
from hydro.core.thrust_curves.table import ThrustTable
from hydro.core.vehicle.description import Battery, Thruster, Vehicle

# Columns of the thruster table.  The first six are the wrench of one newton of thrust, a column of B.
UNIT_WRENCH, UNIT_FORCE, UNIT_MOMENT = slice(0, 6), slice(0, 3), slice(3, 6)
MAX_THRUST = 6  # N at +1
MAX_REVERSE = 7  # N at -1, as a positive number
POWER = 8  # exponent of n in the thrust: 1 linear, 2 quadratic
SPEED_LAG = 9  # 1: the state is the rotor speed; 0: the thrust
DEADBAND = 10  # in n
SHIFT = 11  # 1: continuous beyond the dead band; 0: cut
BEYOND = 12  # effective commands reach 1 + this: thrust of a table above the nominal voltage
TIME_CONSTANT = 13  # s
LAG_STEP = 14  # s, of the source's Euler integration; 0: exact
DELAY = 15  # s
GAIN = 16  # relative gain, thrust times 1 + g
ASYMMETRY = 17  # a, reverse thrust times 1 - a
INFLOW = 18  # c, thrust loss by the water's speed along the axis [s/m]
REACTION = 19  # k, torque about the thrust's axis per thrust [m]; included in the unit wrench
COLUMNS = 20


def same_states(table: Array, other: Array) -> bool:
    """Return whether two thruster tables give the same lag states for the same commands.

    A lag state is a thrust or a rotor speed.

    Args:
        table: Constants of n thrusters, (n, COLUMNS), from `thruster_table`.
        other: Constants of the thrusters to compare.
    """
    after = {*range(COLUMNS)[UNIT_WRENCH], GAIN, ASYMMETRY, INFLOW, REACTION}
    before = [c for c in range(COLUMNS) if c not in after]
    return table.shape == other.shape and np.array_equal(table[:, before], other[:, before])


def configuration_matrix(vehicle: Vehicle) -> Array:
    """Return the configuration matrix B, (6, n): the wrench about CO per newton of each of n thrusts.

    It contains the placements in the file, without the reaction torques of actuator effects; for these see
    `UNIT_WRENCH` of `effects.thruster_table`.

    Raises:
        DataError: A thruster gives neither a position with a direction nor a wrench, or gives both.
    """
    return np.array([_unit_wrench(thruster) for thruster in vehicle.thruster]).reshape(-1, 6).T


def allocate(B: ArrayLike, tau: ArrayLike) -> Array:
    """Return the smallest thrusts whose wrench is closest to a demanded wrench: pinv(B) tau.

    Args:
        B: Configuration matrix of n thrusters, (6, n).
        tau: Demanded wrench in body axes, (..., 6) [N, N m].

    Returns:
        Thrusts, (..., n) [N], not limited; B f = tau if the thrusters can produce tau.
    """
    return np.asarray(np.asarray(tau, float) @ np.linalg.pinv(np.asarray(B, float)).T)


def thruster_table(vehicle: Vehicle) -> Array:
    """Return the thruster table: the constants of the vehicle's n thrusters, one row each, (n, COLUMNS).

    The module names the columns, such as MAX_THRUST.  Gain, asymmetry, inflow and reaction are 0; effects of
    kind `actuator` change them and other columns.

    Raises:
        DataError: A thruster has no placement, or two; its `lag_step` exceeds its time constant; or its curve
            is invalid.
    """
    try:
        return _remembered(vehicle.thruster, vehicle.battery).copy()
    except TypeError:  # lists in the place of tuples
        return _table(vehicle.thruster, vehicle.battery)


def _table(thrusters: tuple[Thruster, ...], battery: Battery | None) -> Array:
    """Return the thruster table of thrusters with a battery."""
    table = np.zeros((len(thrusters), COLUMNS))
    for row, thruster in zip(table, thrusters, strict=True):
        step = thruster.lag_step or 0.0
        if 0.0 < thruster.time_constant < step:
            raise DataError(
                f"thruster {thruster.name}: lag_step {step:g} s exceeds time_constant "
                f"{thruster.time_constant:g} s, where Euler steps overshoot; give the source's step"
            )
        row[UNIT_WRENCH] = _unit_wrench(thruster)
        row[MAX_THRUST], row[MAX_REVERSE], row[BEYOND] = _limits(thruster, thrusters, battery)
        row[POWER] = curve_power(thruster)
        row[SPEED_LAG] = thruster.lag == "speed"
        row[TIME_CONSTANT] = thruster.time_constant
        row[LAG_STEP] = step
        row[DEADBAND] = thruster.deadband
        row[SHIFT] = thruster.deadband_style == "shift"
        row[DELAY] = thruster.delay
    return table


_remembered = lru_cache(maxsize=64)(_table)
"""Cached `_table`: a fit assembles hundreds of vehicles that differ in their effects alone."""


def table_of(thruster: Thruster) -> ThrustTable | None:
    """Return the thrust of a thruster by command and supply voltage, as a table.

    None for a curve with a formula.

    Raises:
        DataError: The file's numbers are not a valid table.
    """
    try:
        return curve_table(thruster.curve)
    except DataError as error:
        raise DataError(f"thruster {thruster.name}: {error}") from error


def curve_power(thruster: Thruster) -> float:
    """Return the exponent p of a thruster's curve: thrust is proportional to |effective command|^p."""
    if thruster.curve in ("linear", "quadratic", "none"):
        return 2.0 if thruster.curve == "quadratic" else 1.0
    return 2.0 if thruster.lag == "speed" else 1.0


def voltage_matters(vehicle: Vehicle) -> bool:
    """Return whether the thrust of any thruster depends on the supply voltage."""
    return _depend_on_voltage(vehicle.thruster)


def _depend_on_voltage(thrusters: tuple[Thruster, ...]) -> bool:
    """Return whether any of the thrusters has a curve for several voltages."""
    tables = map(table_of, thrusters)
    return any(table is not None and table.several for table in tables)


def nominal_voltage(vehicle: Vehicle) -> float:
    """Return the nominal supply voltage of a vehicle file [V]; 0 if the file has none and needs none.

    Raises:
        DataError: A curve has several voltages, and the file does not give the nominal voltage.
    """
    return _nominal_voltage(vehicle.thruster, vehicle.battery)


def _nominal_voltage(thrusters: tuple[Thruster, ...], battery: Battery | None) -> float:
    """Return the nominal supply voltage [V] of thrusters with a battery; 0 without a battery."""
    if battery is not None:
        return battery.voltage
    if _depend_on_voltage(thrusters):
        raise DataError(
            "battery: thrust curves by supply voltage need the nominal one: add [battery] with voltage [V]"
        )
    return 0.0


def _limits(
    thruster: Thruster, thrusters: tuple[Thruster, ...], battery: Battery | None
) -> tuple[float, float, float]:
    """Return the thrust at full command ahead and astern [N], and the excess of effective commands over 1.

    With a table, effective commands exceed 1 above the nominal voltage.
    """
    if not thruster.pushes:
        return 0.0, 0.0, 0.0
    table, given = table_of(thruster), (thruster.max_thrust, thruster.max_reverse_thrust)
    if table is None:
        if given[0] is None or given[1] is None:
            raise DataError(
                f"thruster {thruster.name}: give max_thrust and max_reverse_thrust [N], or a table as curve"
            )
        return given[0], given[1], 0.0
    if given != (None, None) or thruster.deadband:
        raise DataError(
            f"thruster {thruster.name}: its curve is a table, which says the greatest thrusts and the dead "
            "band: leave out max_thrust, max_reverse_thrust and deadband"
        )
    nominal = _nominal_voltage(thrusters, battery)
    ahead, astern = table.limits(nominal)
    if ahead <= 0.0:
        raise DataError(f"thruster {thruster.name}: no thrust at the nominal voltage of {nominal:g} V")
    return ahead, astern, table.most(nominal) ** (1.0 / curve_power(thruster)) - 1.0


@kernel
def raised(size: float, power: float) -> float:
    """Return size^power; a square is computed as one product."""
    return size * size if power == 2.0 else size**power


@kernel
def static_thrust(row: Array, n: float) -> float:
    """Return the steady thrust [N] of one thruster, after dead band and curve.

    Args:
        row: Row of the thruster table.
        n: Normalised rotor speed or effective command, in [-1, 1].
    """
    size: float = abs(n)
    band: float = row[DEADBAND]
    within_band = size <= band
    if row[POWER] != 1.0:
        size, band = raised(size, row[POWER]), raised(band, row[POWER])
    if row[SHIFT]:
        size = (size - band) / (1.0 - band)
    # select without a branch, since the sign of a command is unpredictable
    ahead: float = row[MAX_THRUST]
    astern: float = -row[MAX_REVERSE]
    thrust = size * (ahead if n > 0.0 else astern)
    return 0.0 if within_band else thrust


@kernel
def settled_state(row: Array, command: float) -> float:
    """Return the steady lag state under a constant command: thrust [N], or normalised rotor speed in [-1, 1].

    Args:
        row: Row of the thruster table.
        command: Effective command after the delay; clipped to the range of the curve.
    """
    most: float = 1.0 + row[BEYOND]
    n = min(max(command, -most), most)
    return n if row[SPEED_LAG] else static_thrust(row, n)


@kernel
def lag_decay(row: Array, dt: float) -> float:
    """Return the factor by which a lag state's distance from the steady state shrinks in a time dt [s].

    It is exp(-dt/T) with the time constant T, or (1 - h/T)^(dt/h) if the data come from a simulator that
    integrates by Euler's method with step h.  The exponent dt/h may be any real number, so two parts of a
    step give the same lag as the whole step.

    Args:
        row: Row of the thruster table.
        dt: Time [s].
    """
    constant, step = row[TIME_CONSTANT], row[LAG_STEP]
    if constant <= step:  # no lag, or one that ends within one Euler step
        return 0.0
    if step > 0.0:
        return math.exp(math.log1p(-step / constant) * dt / step)
    return math.exp(-dt / constant)


@kernel
def advance_state(row: Array, state: float, command: float, dt: float) -> float:
    """Return the lag state after a time dt [s] under a constant command, exactly and in one step.

    A lag state is a thrust [N] or a normalised rotor speed.  Without lag the state follows immediately, even
    for dt = 0.

    Args:
        row: Row of the thruster table.
        state: Lag state at the start.
        command: Effective command after the delay.
        dt: Time [s].
    """
    settled = settled_state(row, command)
    return settled + (state - settled) * lag_decay(row, dt)


@kernel
def state_derivative(row: Array, state: float, command: float) -> float:
    """Return the time derivative of the lag state (thrust [N] or normalised rotor speed), per second.

    `advance_state` is the solution.  Without lag the derivative is 0, and `advance_state(row, state, command,
    0.0)` sets the state.

    Args:
        row: Row of the thruster table.
        state: Lag state.
        command: Effective command after the delay.
    """
    constant, step = row[TIME_CONSTANT], row[LAG_STEP]
    if constant <= step:
        return 0.0
    rate: float = -math.log1p(-step / constant) / step if step > 0.0 else 1.0 / constant
    return rate * (settled_state(row, command) - state)


@kernel
def inflow_speed(row: Array, nu_r: Array) -> float:
    """Return the speed through the water along one thruster's axis [m/s]: d . (v_r + omega x r) = b . nu_r.

    d is the direction of the thrust, r the thruster's position, v_r and omega the two halves of nu_r, and b
    the wrench of one newton of thrust without the reaction torque, which has no lever arm.

    Args:
        row: Row of the thruster table.
        nu_r: Velocity of CO through the water, body axes, (6,) [m/s, rad/s].
    """
    speed = 0.0
    for i in range(3):
        speed += row[i] * nu_r[i] + (row[3 + i] - row[REACTION] * row[i]) * nu_r[3 + i]
    return speed


@kernel
def state_to_thrust(row: Array, state: float, inflow: float) -> float:
    """Return the thrust [N] of one thruster for a lag state, with gain, asymmetry and the loss by inflow.

    Args:
        row: Row of the thruster table.
        state: Lag state: thrust [N] before losses, or normalised rotor speed.
        inflow: Speed through the water along the thruster's axis [m/s].
    """
    thrust: float = static_thrust(row, state) if row[SPEED_LAG] else state
    thrust *= 1.0 + row[GAIN]
    if thrust < 0.0:
        thrust *= 1.0 - row[ASYMMETRY]
    if row[INFLOW] != 0.0:  # avoids the square root for most vehicles
        thrust -= row[INFLOW] * math.sqrt(abs(thrust) * row[MAX_THRUST]) * inflow
    return thrust


@jit
def _states_kernel(
    table: Array, commands: Array, t: Array, times: Array, settled: bool, close: float, out: Array
) -> None:
    """Write lag states at ascending `times` >= t[0]; command k acts from t[k] + delay, within `close` [s]."""
    count, rows = table.shape[0], t.size
    state, target, now = np.zeros(count), np.zeros(count), np.full(count, t[0])
    upcoming = np.zeros(count, np.int64)
    step_before, decay = np.zeros(count), np.zeros(count)
    if settled:
        for i in range(count):
            state[i] = target[i] = settled_state(table[i], commands[0, i])
    for m in range(times.size):
        for i in range(count):
            row = table[i]
            while upcoming[i] < rows:
                switch = t[upcoming[i]] + row[DELAY]
                if switch >= times[m] - close:
                    break
                if switch > now[i] + close:  # a fractional delay: the old command acts on the first part
                    state[i] = target[i] + (state[i] - target[i]) * lag_decay(row, switch - now[i])
                    now[i] = switch
                target[i] = settled_state(row, commands[upcoming[i], i])
                upcoming[i] += 1
            step = times[m] - now[i]
            if step > 0.0:
                if abs(step - step_before[i]) > 1e-9 * step:
                    step_before[i], decay[i] = step, lag_decay(row, step)
                state[i] = target[i] + (state[i] - target[i]) * decay[i]
                now[i] = times[m]
            out[m, i] = state[i]


@kernel
def _thrust_kernel(table: Array, states: Array, nu_r: Array, out: Array) -> None:
    """Write the thrusts of lag states (N, n); `nu_r` is (N, 6), or (0, 6) for rest in still water."""
    for k in range(states.shape[0]):
        for i in range(table.shape[0]):
            inflow = inflow_speed(table[i], nu_r[k]) if nu_r.shape[0] else 0.0
            out[k, i] = state_to_thrust(table[i], states[k, i], inflow)


def lag_states(
    table: Array, commands: ArrayLike, t: ArrayLike, times: ArrayLike, *, settled: bool = False
) -> Array:
    """Return the lag states of thrusters at given times of one segment.

    A lag state is a thrust [N] before losses, or a normalised rotor speed.

    Args:
        table: Table of n thrusters, (n, COLUMNS).
        commands: Effective commands in N rows, (N, n); row k is held on [t_k, t_k+1), the last row for ever.
        t: Times of the commands [s], (N,), ascending.
        times: Times of M states [s], (M,), ascending, from t[0] on.
        settled: Whether the thrusters start in the steady state of the first command, as after a gap; else
            they start at rest, with a command of 0 before the first.

    Returns:
        States, (M, n): limits from the left where a command changes.

    Raises:
        DataError: The commands' shape does not fit the thrusters or the times.
    """
    held, clock = _commands(table, commands, t)
    moments = np.ascontiguousarray(times, dtype=np.float64)
    out = np.empty((moments.size, table.shape[0]))
    if clock.size and moments.size:
        _states_kernel(table, held, clock, moments, settled, _close(clock), out)
    return out


def thrusts(
    table: Array,
    commands: ArrayLike,
    t: ArrayLike,
    segments: ArrayLike,
    *,
    after_gap: ArrayLike | None = None,
    nu_r: ArrayLike | None = None,
) -> Array:
    """Return the thrusts at every row of a log, (N, n) [N].

    Args:
        table: Table of n thrusters, (n, COLUMNS): that of `effects.thruster_table`, which contains the
            vehicle's actuator effects, or of `thruster_table` without them.
        commands: Effective commands in N rows, (N, n).
        t: Times [s], (N,), ascending within each segment.
        segments: First and past-the-last row of each of S segments, (S, 2).
        after_gap: Mask of the segments that follow a gap within a session, (S,), and so start in the steady
            state of their first command.  All other segments start at rest; by default all do.
        nu_r: Velocity of CO relative to the water, body axes, (N, 6); by default there is no inflow.

    Returns:
        Thrusts, (N, n) [N]; rows outside all segments are 0.

    Raises:
        DataError: The commands' shape does not fit the thrusters or the times.
    """
    held, clock = _commands(table, commands, t)
    bounds = np.asarray(segments, np.int64).reshape(-1, 2)
    settled = np.zeros(len(bounds), bool) if after_gap is None else np.asarray(after_gap, bool)
    out = np.zeros(held.shape)
    for (start, stop), resumed in zip(bounds, settled, strict=True):
        if stop > start:
            part = clock[start:stop]
            _states_kernel(table, held[start:stop], part, part, resumed, _close(part), out[start:stop])
    water = np.empty((0, 6)) if nu_r is None else np.ascontiguousarray(nu_r, dtype=np.float64)
    _thrust_kernel(table, out, water, out)
    return out


def _unit_wrench(thruster: Thruster) -> Array:
    """Return the wrench about CO of one newton of thrust, shape (6,)."""
    position, direction, wrench = thruster.position, thruster.direction, thruster.wrench
    if not thruster.pushes:
        if thruster != Thruster(name=thruster.name, curve="none"):
            raise DataError(f'thruster {thruster.name}: with curve "none", give only a name')
        return np.zeros(6)
    if wrench is not None and position is None and direction is None:
        return np.array(wrench)
    if wrench is not None or position is None or direction is None:
        raise DataError(f"thruster {thruster.name}: give either position and direction, or wrench")
    (x, y, z), (a, b, c) = position, direction
    return np.array([a, b, c, y * c - z * b, z * a - x * c, x * b - y * a])


def _commands(table: Array, commands: ArrayLike, t: ArrayLike) -> tuple[Array, Array]:
    """Return commands and times as C-contiguous float64 that fit the thrusters and each other."""
    held = np.ascontiguousarray(commands, dtype=np.float64)
    clock = np.ascontiguousarray(t, dtype=np.float64)
    if held.ndim != 2 or held.shape != (clock.size, len(table)):
        raise DataError(
            f"commands: expected {clock.size} rows of {len(table)} thrusters, got shape {held.shape}; "
            "use the vehicle file that the log was recorded with"
        )
    return held, clock


def _close(t: Array) -> float:
    """Return the tolerance of times [s]: clock rounding must not move a command by a whole row."""
    step = (t[-1] - t[0]) / max(t.size - 1, 1)
    return float(1e-9 * step + 1e-15 * abs(t[-1]))
