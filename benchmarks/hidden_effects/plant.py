"""Independent simulator of the benchmark: a second implementation of Fossen's equations of motion.

It shares no code with `hydro.core`, since a diagnosis validated only on its own simulator is not convincing.
It also has effects that the catalogue lacks (`FOREIGN`).  World NED, body FRD, eta = (p, quaternion), nu =
(u, v, w, p, q, r) of the body's origin, over ground; forces are those ON the vehicle (T. I. Fossen: Handbook
of Marine Craft Hydrodynamics and Motion Control, Wiley 2011).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from benchmarks.hidden_effects.parts import Parts, cross, hang, push
from hydro.core.columns import Array

STEP = 0.01
"""Longest step of integration [s], classical Runge-Kutta."""
BODY = 13  # states of the rigid body: position, quaternion, velocity
MEMORY, SLOSH, HYSTERESIS, BALLAST = 6, 4, 3, 2  # further states, after two per thruster
STATIONS = 41  # of the hull, for Simpson's rule

FOREIGN = (
    "cubic",  # N s^3/m^3 in surge, sway and heave as a multiple of the hull's quadratic damping
    "power",  # the same of |u|^1.5
    "wash",  # heave force per thrust of the first half of the thrusters
    "wash_pitch",  # pitch moment per the same [m]
    "tide",  # m/s, amplitude of a current north that swings
    "tide_east",  # m/s
    "tide_rate",  # rad/s
    "slosh_mass",  # kg
    "slosh_rate",  # rad/s
    "slosh_z",  # m, where the loose mass hangs
    "wall",  # N, greatest pull east
    "wall_x",  # m north, where it is greatest
    "wall_width",  # m
    "hysteresis",  # N, greatest force of surge and sway; a fifth of it in yaw [N m]
    "hysteresis_path",  # m or rad until it is reached
    "swell",  # N, amplitude of a heave force
    "swell_rate",  # rad/s
    "shear",  # 1/m, growth of the current with depth
    "depth",  # m, where shear and compression begin
    "gain_drift",  # 1/s, growth of the gains' deviations with time
    "second_lag",  # s, of a further first-order lag behind the rotor's
    "stall",  # rad, drift angle at which lift has lost half
    "compression",  # 1/m, growth of the extra buoyancy with depth
    "stiffening",  # 1/m, growth of the tether's stiffness with its stretch
    "taper",  # share of cross-flow drag that the bow lacks and the stern has more
)
"""Parameters of effects that the catalogue lacks, or has in another form; 0 if absent."""
(
    CUBIC, POWER, WASH, WASH_PITCH, TIDE, TIDE_EAST, TIDE_RATE, SLOSH_MASS, SLOSH_RATE, SLOSH_Z, WALL, WALL_X,
    WALL_WIDTH, HYSTERESIS_FORCE, HYSTERESIS_PATH, SWELL, SWELL_RATE, SHEAR, DEPTH, GAIN_DRIFT, SECOND_LAG,
    STALL, COMPRESSION, STIFFENING, TAPER,
) = range(len(FOREIGN))  # fmt: skip


class Plant(NamedTuple):
    """A vehicle in numbers, without its sensors.

    Attributes:
        rigid: M_RB with the dry mass of payloads, (6, 6).
        added: M_A, (6, 6).
        inverse: Inverse of their sum.
        kappa: Share of C_A that acts in addition to C_A itself.
        weights: Forces downward in the world with their points, (K, 4): N, m.
        lifted: Extra buoyancy [N] and where it acts, (4,); it may grow with depth.
        linear: D_L, (6, 6).
        quadratic: Diagonal of D_Q, (6,).
        across: Drag of each axis per speed along another one, (6, 3).
        drag: 1/2 rho Cd H and 1/2 rho Cd W, (2,).
        span: Hull length and the x of its centre, (2,).
        lift: Y, N of v, r and Z, M of w, q per |u|, (2, 2, 2).
        current: v_c NED, (3,).
        gradient: Growth of v_c north and east with depth [1/s], and the depth where it is v_c, (3,).
        trend: Growth of v_c north and east with time [m/s^2], the time when it is v_c, and the mass of
            displaced water [kg], (4,).
        ballast: Weight times travel along x and y [N m], tilt and time constant of ballast that slides, (4,).
        tether: Stiffness k, slack length, attachment on the body, anchor, (8,).
        suction: Force A, decay length and the point where it acts, (5,).
        memory: Gain K of six axes and the rate, (7,).
        parts: Drag and lift away from CO, and drag of any power.
        thrusts: Unit wrenches of the thrusters, (n, 6).
        reactions: Torque of each thruster about its axis per thrust, (n,) [m].
        limits: Greatest thrust ahead and astern, (n, 2).
        chains: Power of the curve, speed lag, time constant, dead band, shifted dead band, (n, 5).
        gains: Relative deviation of each thrust, (n,).
        asymmetry: Share of reverse thrust lost.
        inflow: Loss to the water's speed [s/m].
        delay: Delay of the commands [s].
        foreign: Effects that the catalogue lacks, in the order of FOREIGN.
        laws: Further forces, a row each, (K, 8): the axis, a coefficient, an odd velocity with its power and
            the size below which it does nothing; another velocity, or -1, its power and whether it is odd.
    """

    rigid: Array
    added: Array
    inverse: Array
    kappa: float
    weights: Array
    lifted: Array
    linear: Array
    quadratic: Array
    across: Array
    drag: Array
    span: Array
    lift: Array
    current: Array
    gradient: Array
    trend: Array
    ballast: Array
    tether: Array
    suction: Array
    memory: Array
    parts: Parts
    thrusts: Array
    reactions: Array
    limits: Array
    chains: Array
    gains: Array
    asymmetry: float
    inflow: float
    delay: float
    foreign: Array
    laws: Array


@njit(cache=True)
def turned(q: Array) -> Array:
    """Return the rotation matrix (3, 3) from body to NED of a quaternion (w, x, y, z) (Fossen 2.72)."""
    w, x, y, z = q / np.sqrt((q * q).sum())
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@njit(cache=True)
def coriolis(M: Array, nu: Array) -> Array:
    """Return C(nu) nu (6,) of a mass matrix M (6, 6) (Fossen 3.46)."""
    momentum = M @ nu
    out = np.empty(6)
    out[:3] = cross(nu[3:], momentum[:3])
    out[3:] = cross(nu[:3], momentum[:3]) + cross(nu[3:], momentum[3:])
    return out


@njit(cache=True)
def water(plant: Plant, z: float, sink: float, t: float) -> tuple[Array, Array]:
    """Return the velocity of the water and its rate along the vehicle's motion, NED, (3,) each.

    Args:
        plant: The vehicle.
        z: Depth [m].
        sink: Rate of the depth [m/s].
        t: Time [s].
    """
    f = plant.foreign
    v, rate = plant.current * (1.0 + f[SHEAR] * (z - f[DEPTH])), plant.current * (f[SHEAR] * sink)
    below = z - plant.gradient[2]
    for i in range(2):
        v[i] += plant.gradient[i] * below + plant.trend[i] * (t - plant.trend[2])
        rate[i] += plant.gradient[i] * sink + plant.trend[i]
    swing, speed = math.sin(f[TIDE_RATE] * t), f[TIDE_RATE] * math.cos(f[TIDE_RATE] * t)
    v[0] += f[TIDE] * swing
    v[1] += f[TIDE_EAST] * swing
    rate[0] += f[TIDE] * speed
    rate[1] += f[TIDE_EAST] * speed
    return v, rate


@njit(cache=True)
def static(chain: Array, limit: Array, n: float) -> float:
    """Return the steady thrust of a rotor: dead band and curve."""
    size, band = abs(n), chain[3]
    if size <= band:
        return 0.0
    if chain[0] != 1.0:
        size, band = size ** chain[0], band ** chain[0]
    if chain[4] > 0.0:
        size = (size - band) / (1.0 - band)
    return size * limit[0] if n > 0.0 else -size * limit[1]


@njit(cache=True)
def propel(plant: Plant, rotor: Array, nu_r: Array, t: float, tau: Array) -> Array:
    """Add the thrusters' wrench to `tau` (6,), and return their thrusts (n,) [N]."""
    out = np.empty(rotor.size)
    for i in range(rotor.size):
        f = static(plant.chains[i], plant.limits[i], rotor[i]) if plant.chains[i, 1] > 0.0 else rotor[i]
        f *= 1.0 + plant.gains[i] * (1.0 + plant.foreign[GAIN_DRIFT] * t)
        if f < 0.0:
            f *= 1.0 - plant.asymmetry
        speed = (plant.thrusts[i] * nu_r).sum()
        f -= plant.inflow * math.sqrt(abs(f) * plant.limits[i, 0]) * speed
        tau += plant.thrusts[i] * f
        tau[3:] += plant.reactions[i] * f * plant.thrusts[i, :3]
        out[i] = f
    return out


@njit(cache=True)
def resist(plant: Plant, n: Array, tau: Array) -> None:
    """Add damping, cross-flow drag and lift (Fossen 6.4)."""
    f = plant.foreign
    tau -= plant.linear @ n + (plant.quadratic * np.abs(n) + plant.across @ np.abs(n[:3])) * n
    for k in range(plant.laws.shape[0]):
        axis, amount, odd, power, least, other, raised, signed = plant.laws[k]
        here = n[int(odd)]
        force = amount * math.copysign(max(abs(here) - least, 0.0) ** power, here)
        if other >= 0.0:
            there = n[int(other)]
            force *= abs(there) ** raised * (math.copysign(1.0, there) if signed > 0.0 else 1.0)
        tau[int(axis)] += force
    tau -= plant.quadratic * (f[CUBIC] * n**3 + f[POWER] * np.sign(n) * np.abs(n) ** 1.5)
    if plant.drag.any():
        length, step = plant.span[0], plant.span[0] / (STATIONS - 1)
        for k in range(STATIONS):
            x = plant.span[1] - 0.5 * length + k * step
            weight = step / 3.0 * (1.0 if k in (0, STATIONS - 1) else 4.0 if k % 2 else 2.0)
            weight *= 1.0 - f[TAPER] * 2.0 * (x - plant.span[1]) / length
            side, below = n[1] + x * n[5], n[2] - x * n[4]
            y, z = -plant.drag[0] * abs(side) * side * weight, -plant.drag[1] * abs(below) * below * weight
            tau[1] += y
            tau[5] += x * y
            tau[2] += z
            tau[4] -= x * z
    left = 1.0
    if f[STALL] > 0.0:
        left = 1.0 / (1.0 + (math.atan2(math.hypot(n[1], n[2]), abs(n[0]) + 1e-9) / f[STALL]) ** 2)
    speed = left * abs(n[0])
    tau[1] -= speed * (plant.lift[0, 0, 0] * n[1] + plant.lift[0, 0, 1] * n[5])
    tau[5] -= speed * (plant.lift[0, 1, 0] * n[1] + plant.lift[0, 1, 1] * n[5])
    tau[2] -= speed * (plant.lift[1, 0, 0] * n[2] + plant.lift[1, 0, 1] * n[4])
    tau[4] -= speed * (plant.lift[1, 1, 0] * n[2] + plant.lift[1, 1, 1] * n[4])


@njit(cache=True)
def surround(plant: Plant, p: Array, R: Array, t: float, tau: Array) -> None:
    """Add weights, buoyancy, tether, suction and other forces that depend on the place."""
    f, down = plant.foreign, R[2].copy()
    for k in range(plant.weights.shape[0]):
        push(tau, plant.weights[k, 0] * down, plant.weights[k, 1:])
    lifted = plant.lifted[0] * (1.0 + f[COMPRESSION] * (p[2] - f[DEPTH]))
    push(tau, -lifted * down, plant.lifted[1:])
    if plant.suction[0] != 0.0:
        pull = plant.suction[0] * math.exp(-max(p[2], 0.0) / plant.suction[1])
        push(tau, -pull * down, plant.suction[2:])
    if plant.tether[0] > 0.0:
        attachment = plant.tether[2:5]
        line = plant.tether[5:] - (p + R @ attachment)
        distance = math.sqrt((line * line).sum())
        stretch = max(distance - plant.tether[1], 0.0)
        pull = plant.tether[0] * stretch * (1.0 + f[STIFFENING] * stretch)
        push(tau, R.T @ (line * (pull / max(distance, 1e-9))), attachment)
    if f[WALL] != 0.0:
        tau[:3] += R[1] * (f[WALL] / (1.0 + ((p[0] - f[WALL_X]) / f[WALL_WIDTH]) ** 2))
    tau[2] += f[SWELL] * math.sin(f[SWELL_RATE] * t)
    stirred = np.array([plant.trend[0], plant.trend[1], 0.0])
    accelerating = plant.trend[3] * (R.T @ stirred)  # the pressure that accelerates the water
    push(tau, accelerating, plant.weights[-1, 1:])


@njit(cache=True)
def rested(plant: Plant, R: Array) -> Array:
    """Return the steady displacement of loose ballast at an attitude: weight times distance (2,)."""
    e = np.exp(2.0 * R[2, :2] / plant.ballast[2])
    return plant.ballast[:2] * (e - 1.0) / (e + 1.0)


@njit(cache=True)
def rates(plant: Plant, y: Array, target: Array, t: float) -> Array:
    """Return the time derivative of the state; `target` holds the steady lag states of the rotors, (n,)."""
    count, f = target.size, plant.foreign
    out = np.zeros(y.size)
    p, q, nu = y[:3], y[3:7], y[7:BODY]
    at = BODY + 2 * count
    memory, slosh, bristle = y[at : at + 6], y[at + 6 : at + 10], y[at + 10 : at + 13]
    slid = y[at + 13 : at + 15]
    R = turned(q)
    sink = R[2] @ nu[:3]
    v_c, v_c_rate = water(plant, p[2], sink, t)
    carried = R.T @ v_c
    nu_r = nu.copy()
    nu_r[:3] -= carried

    tau = -coriolis(plant.rigid, nu) - (1.0 + plant.kappa) * coriolis(plant.added, nu_r)
    turning = np.zeros(6)  # nu_r_dot less nu_dot
    turning[:3] = cross(nu[3:], carried) - R.T @ v_c_rate
    tau -= plant.added @ turning
    rotor = y[BODY + count : at] if f[SECOND_LAG] > 0.0 else y[BODY : BODY + count]
    thrust = propel(plant, rotor, nu_r, t, tau)
    resist(plant, nu_r, tau)
    hang(plant.parts, nu_r, tau)
    surround(plant, p, R, t, tau)
    change = nu_r - plant.memory[6] * memory
    tau -= plant.memory[:6] * change
    washed = np.abs(thrust[: count // 2]).sum()
    tau[2] += f[WASH] * washed
    tau[4] += f[WASH_PITCH] * washed
    grip = np.array([f[HYSTERESIS_FORCE], f[HYSTERESIS_FORCE], 0.2 * f[HYSTERESIS_FORCE]])
    sliding = np.array([nu[0], nu[1], nu[5]])
    tau[0] -= grip[0] * bristle[0]
    tau[1] -= grip[1] * bristle[1]
    tau[5] -= grip[2] * bristle[2]
    stiff, damp = f[SLOSH_RATE] ** 2, 0.1 * f[SLOSH_RATE]
    swung = np.zeros(3)
    swung[:2] = f[SLOSH_MASS] * (stiff * slosh[:2] + damp * slosh[2:])
    push(tau, swung, np.array([0.0, 0.0, f[SLOSH_Z]]))

    tau[3:] += cross(np.array([slid[0], slid[1], 0.0]), R[2])  # of weight here that was at the middle

    nu_dot = plant.inverse @ tau
    out[:3] = R @ nu[:3]
    w, x, yy, z = q
    a, b, c = nu[3:]
    out[3] = -0.5 * (x * a + yy * b + z * c)
    out[4] = 0.5 * (w * a + yy * c - z * b)
    out[5] = 0.5 * (w * b - x * c + z * a)
    out[6] = 0.5 * (w * c + x * b - yy * a)
    out[3:7] += 2.0 * (1.0 - (q * q).sum()) * q
    out[7:BODY] = nu_dot
    for i in range(count):
        out[BODY + i] = (target[i] - y[BODY + i]) / plant.chains[i, 2]
        if f[SECOND_LAG] > 0.0:
            out[BODY + count + i] = (y[BODY + i] - y[BODY + count + i]) / f[SECOND_LAG]
    out[at : at + 6] = change
    if f[SLOSH_MASS] > 0.0:
        felt = nu_dot[:3] + cross(nu[3:], nu[:3]) - 9.81 * R[2]
        out[at + 6 : at + 8] = slosh[2:]
        out[at + 8 : at + 10] = -stiff * slosh[:2] - damp * slosh[2:] - felt[:2]
    if plant.ballast[3] > 0.0:
        out[at + 13 : at + 15] = (rested(plant, R) - slid) / plant.ballast[3]
    if f[HYSTERESIS_FORCE] > 0.0:
        out[at + 10 : at + 13] = (sliding - np.abs(sliding) * bristle) / f[HYSTERESIS_PATH]
    return out


@njit(cache=True)
def march(plant: Plant, y: Array, target: Array, t: float, span: float) -> Array:
    """Return the state after `span` [s] with constant targets of the rotors."""
    steps = max(math.ceil(span / STEP - 1e-9), 1)
    h = span / steps
    for k in range(steps):
        at = t + k * h
        k1 = rates(plant, y, target, at)
        k2 = rates(plant, y + 0.5 * h * k1, target, at + 0.5 * h)
        k3 = rates(plant, y + 0.5 * h * k2, target, at + 0.5 * h)
        k4 = rates(plant, y + h * k3, target, at + h)
        y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return y


@njit(cache=True)
def settled(plant: Plant, command: Array) -> Array:
    """Return the steady lag states of all rotors."""
    out = np.empty(command.size)
    for i in range(command.size):
        n = min(max(command[i], -1.0), 1.0)
        out[i] = n if plant.chains[i, 1] > 0.0 else static(plant.chains[i], plant.limits[i], n)
    return out


@njit(cache=True)
def commanded(believed: Plant, allocation: Array, wrench: Array) -> Array:
    """Return commands for a wrench, with the thrusters of the file; dead bands are not compensated."""
    thrust = allocation @ wrench
    out = np.empty(thrust.size)
    for i in range(thrust.size):
        limit = believed.limits[i, 0] if thrust[i] > 0.0 else believed.limits[i, 1]
        size = min(abs(thrust[i]) / limit, 1.0)
        size = size ** (1.0 / believed.chains[i, 0])
        out[i] = size if thrust[i] > 0.0 else -size
    return out


@njit(cache=True)
def steer(believed: Plant, allocation: Array, gains: Array, y: Array, depth: float, demand: Array) -> Array:
    """Return commands for a demanded wrench and a weak hold of depth and attitude, by the vehicle file.

    Args:
        believed: Vehicle of the file.
        allocation: From a wrench to thrusts (n, 6).
        gains: Stiffness and damping of heave, roll and pitch, (3, 2).
        y: State.
        depth: Depth to hold [m].
        demand: Demanded wrench (6,).
    """
    R, nu, wrench = turned(y[3:7]), y[7:BODY], demand.copy()
    sink = R[2] @ nu[:3]
    wrench[:3] += R[2] * (gains[0, 0] * (depth - y[2]) - gains[0, 1] * sink)
    wrench[3] -= gains[1, 0] * R[2, 1] + gains[1, 1] * nu[3]
    wrench[4] += gains[2, 0] * R[2, 0] - gains[2, 1] * nu[4]
    return commanded(believed, allocation, wrench)


@njit(cache=True)
def resting(plant: Plant, first: Array) -> Array:
    """Return the complete state of a vehicle at the body state `first` (13,), in steady motion so far."""
    count = plant.gains.size
    y = np.zeros(BODY + 2 * count + MEMORY + SLOSH + HYSTERESIS + BALLAST)
    y[:BODY] = first
    at = BODY + 2 * count
    if plant.memory[6] > 0.0:
        R = turned(y[3:7])
        y[at : at + 6] = y[7:BODY]
        y[at : at + 3] -= R.T @ water(plant, y[2], R[2] @ y[7:10], 0.0)[0]
        y[at : at + 6] /= plant.memory[6]
    if plant.ballast[3] > 0.0:
        y[-BALLAST:] = rested(plant, turned(y[3:7]))
    return y


@njit(cache=True)
def onward(plant: Plant, y: Array, commands: Array, k: int, dt: float) -> Array:
    """Return the state one row of `dt` [s] after row `k`, under commands (N, n) up to row `k`."""
    count = plant.gains.size
    whole = int(plant.delay / dt + 1e-9)
    part = plant.delay - whole * dt
    now, old = k - whole, k - whole - 1
    if part > 1e-9:
        target = settled(plant, commands[old] if old >= 0 else np.zeros(count))
        y = march(plant, y, target, k * dt, part)
    target = settled(plant, commands[now] if now >= 0 else np.zeros(count))
    y = march(plant, y, target, k * dt + part, dt - part)
    return y


@njit(cache=True)
def fly(
    plant: Plant, believed: Plant, allocation: Array, gains: Array, demand: Array, first: Array, dt: float
) -> tuple[Array, Array]:
    """Fly one session under demanded wrenches (N, 6), held at the first state's depth.

    Args:
        plant: The simulated vehicle.
        believed: Vehicle of the file, which the commands are computed with.
        allocation: From a wrench to thrusts (n, 6).
        gains: Stiffness and damping of heave, roll and pitch, (3, 2).
        demand: Demanded wrench of each row (N, 6).
        first: Body state at the start (13,).
        dt: Row interval [s].

    Returns:
        States at every row (N, 13), NaN after a divergence; and commands (N, n).
    """
    rows, count = demand.shape[0], plant.gains.size
    states, commands = np.full((rows, BODY), np.nan), np.zeros((rows, count))
    y = resting(plant, first)
    for k in range(rows):
        if not np.abs(y).max() < 1e6:
            break
        states[k] = y[:BODY]
        commands[k] = steer(believed, allocation, gains, y, first[2], demand[k])
        y = onward(plant, y, commands, k, dt)
    return states, commands
