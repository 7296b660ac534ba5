"""MuJoCo's callbacks for vehicles in water, in machine code: no Python, no GIL, no memory between calls.

With nu the FRD velocity of CO, T the map from MuJoCo's velocity to it (`T qvel = nu`) and nu_r the velocity
through the water, `passive` adds for each vehicle::

    M            += T^T I T                                          added mass is inertia, not feedback
    qfrc_passive += T^T (I [omega x v_r; 0] - C(nu_r) nu_r + C_cancelled(nu) nu + effects - tau_held)

with nu_r for nu in C_cancelled and in the network where that learnt in still water (`water.residual`).
[omega x v_r; 0] is there because MuJoCo's linear acceleration is the world's derivative, and because a
current that is steady in the world turns in the body (`simulation.dynamics`).  `sensor` runs once per step,
on the state that the step begins with: it begins control steps and sets internal states at the start.  `rate`
is the thrusters' lag, and `thrust` their thrust where it is more than a multiple of the lag state.

The kernels are those of `core`, the same that `simulation.simulate` runs; parameters lie in numeric fields
(`sim.bridge.water`) and states in activations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray, types
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.compiled import cfunc, jit
from hydro.core.effects import layout
from hydro.core.effects.program import STATE_COUNT, THRUSTER_COUNT, relative_to_water, start, wrench
from hydro.core.vehicle.frames import HALF_TURN
from hydro.core.vehicle.rigid_body import coriolis_kernel
from hydro.core.vehicle.thrusters import (
    INFLOW,
    LAG_STEP,
    TIME_CONSTANT,
    advance_state,
    inflow_speed,
    lag_decay,
    settled_state,
    state_derivative,
    state_to_thrust,
)
from hydro.sim.bridge import structs, water
from hydro.sim.bridge.pointers import ROOM, as_doubles, field, integers, number, numbers, pointer, stack
from hydro.sim.residual import control

Integers = NDArray[np.int32]

_mj_factorM = types.ExternalFunction("mj_factorM", types.void(types.intp, types.intp))
_mj_makeM = types.ExternalFunction("mj_makeM", types.void(types.intp, types.intp))
_mj_readCtrl = types.ExternalFunction(
    "mj_readCtrl",
    types.intp(
        types.intp, types.intp, types.int32, types.float64, types.CPointer(types.float64), types.int32
    ),
)
S = slice(9, 9 + layout.MOTION)
"""Where the state of motion stands in the room on the stack, behind a rotation,"""
TAU, PART, HALF = slice(S.stop, S.stop + 6), slice(S.stop + 6, S.stop + 12), slice(S.stop + 12, S.stop + 48)
"""and behind it two wrenches and an inertia."""
FUNCTIONS = ("mj_factorM", "mj_makeM", "mj_readCtrl")


@jit
def _observe(data: int, vehicle: Array, P: Array, s: Array) -> None:
    """The state of motion `s` of `core.effects.layout`, and P (3, 3): z-up world components to body FRD."""
    s[layout.TIME] = number(data, structs.TIME)
    body, dof = int(vehicle[water.AT_BODY]), int(vehicle[water.AT_DOF])
    xmat, xpos, qvel = (
        numbers(data, structs.XMAT, 9 * body, 9),
        numbers(data, structs.XPOS, 3 * body, 3),
        numbers(data, structs.QVEL, dof, 6),
    )
    for i in range(3):
        here = HALF_TURN[i]
        for j in range(3):
            there = HALF_TURN[j]
            P[i, j] = here * xmat[3 * j + i]
            s[layout.ROTATION + 3 * i + j] = here * there * xmat[3 * i + j]
        s[layout.POSITION + i] = here * xpos[i]
        s[layout.VELOCITY + 3 + i] = here * qvel[3 + i]
    for i in range(3):
        s[layout.VELOCITY + i] = P[i, 0] * qvel[0] + P[i, 1] * qvel[1] + P[i, 2] * qvel[2]
    relative_to_water(structs.program_of(vehicle), s)


@jit
def _heed(model: int, data: int, vehicle: Array, s: Array) -> None:
    """Write the commands of this step into `s`, as given, before any delay."""
    count, first = int(structs.program_of(vehicle)[THRUSTER_COUNT]), int(vehicle[water.AT_ACTUATOR])
    for i in range(min(count, layout.MOST_COMMANDS)):
        s[layout.COMMANDS + i] = structs.given_command(model, data, first + i)


@jit
def _felt(vehicle: Array, s: Array) -> Array:
    """The velocity (6,) that a residual network is asked about: over ground, or through the water."""
    at = layout.RELATIVE_VELOCITY if vehicle[water.AT_DRIFTING] > 0.0 else layout.VELOCITY
    return s[at : at + 6]


@jit
def _exert(P: Array, tau: Array, force: Array) -> None:
    """Add T^T tau to `force` (6,): a body wrench (FRD, about CO) as MuJoCo's generalised force."""
    for j in range(3):
        force[j] += P[0, j] * tau[0] + P[1, j] * tau[1] + P[2, j] * tau[2]
    force[3] += tau[3]
    force[4] -= tau[4]
    force[5] -= tau[5]


@jit
def _add_transport(A: Array, nu: Array, tau: Array) -> None:
    """Add A [omega x v; 0] to `tau` (6,), for an inertia A (36,)."""
    x = nu[4] * nu[2] - nu[5] * nu[1]
    y = nu[5] * nu[0] - nu[3] * nu[2]
    z = nu[3] * nu[1] - nu[4] * nu[0]
    for i in range(6):
        tau[i] += A[6 * i] * x + A[6 * i + 1] * y + A[6 * i + 2] * z


@jit
def _add_coriolis(A: Array, factor: float, nu: Array, part: Array, tau: Array) -> None:
    """Add factor C(nu) nu to `tau` (6,), for an inertia A (36,); `part` (6,) is scratch."""
    for i in range(6):
        part[i] = 0.0
    coriolis_kernel(A, nu, part)
    for i in range(6):
        tau[i] += factor * part[i]


@jit
def _add_inertia(A: Array, P: Array, half: Array, rows: Integers, addresses: Integers, M: Array) -> None:
    """Add T^T A T (A of 36) to six rows of MuJoCo's lower triangle; where a row is not full, make it NaN.

    T = diag(P, F); `half` (6, 6) is scratch for A T.
    """
    for i in range(6):
        for j in range(3):
            half[i, j] = A[6 * i] * P[0, j] + A[6 * i + 1] * P[1, j] + A[6 * i + 2] * P[2, j]
        half[i, 3], half[i, 4], half[i, 5] = A[6 * i + 3], -A[6 * i + 4], -A[6 * i + 5]
    for i in range(3):
        at = addresses[i]
        for j in range(i + 1):
            M[at + j] += P[0, i] * half[0, j] + P[1, i] * half[1, j] + P[2, i] * half[2, j]
        sign = HALF_TURN[i]
        at = addresses[3 + i]
        for j in range(4 + i):
            M[at + j] += sign * half[3 + i, j]
    for i in range(6):
        if rows[i] != i + 1:
            M[addresses[i]] = np.nan


@jit
def _add_forces(model: int, data: int, vehicle: Array) -> None:
    """Add one vehicle's inertia and forces."""
    room = carray(stack(), (ROOM,), np.float64)
    P, s, tau, part, half = (
        room[0:9].reshape(3, 3),
        room[S],
        room[TAU],
        room[PART],
        room[HALF].reshape(6, 6),
    )
    for i in range(6):
        tau[i] = 0.0
    _observe(data, vehicle, P, s)
    nu_r, felt = s[layout.RELATIVE_VELOCITY : layout.RELATIVE_VELOCITY + 6], _felt(vehicle, s)
    dof = int(vehicle[water.AT_DOF])

    if vehicle[water.AT_EFFECTS] > 0.0:
        program, at = structs.program_of(vehicle), int(vehicle[water.AT_STATES])
        _heed(model, data, vehicle, s)
        count = int(program[STATE_COUNT])
        if count:  # MuJoCo clears `act_dot` after this stage: rates written here only need somewhere to go
            wrench(
                program,
                s,
                numbers(data, structs.ACT, at, count),
                numbers(data, structs.ACT_DOT, at, count),
                tau,
            )
        else:
            wrench(program, s, part[:0], part[:0], tau)
    at = int(vehicle[water.AT_CORIOLIS])
    if at:
        _add_coriolis(vehicle[at : at + 36], -1.0, nu_r, part, tau)
    at = int(vehicle[water.AT_CANCELLED])
    if at:
        _add_coriolis(vehicle[at : at + 36], 1.0, felt, part, tau)
    at = int(vehicle[water.AT_HELD])
    if at >= 0:
        _take(numbers(data, structs.USERDATA, at, 6), tau)
    if vehicle[water.AT_CONTROL] > 0.0:
        block = vehicle[int(vehicle[water.AT_CONTROL]) :]
        control.exert(block, structs.control_states(data, vehicle), felt, part, tau)
    at = int(vehicle[water.AT_INERTIA])
    if at:
        A = vehicle[at : at + 36]
        _add_transport(A, nu_r, tau)
        addresses = integers(model, structs.M_ROWADR, dof, 6)
        _add_inertia(
            A,
            P,
            half,
            integers(model, structs.M_ROWNNZ, dof, 6),
            addresses,
            numbers(data, structs.M, 0, addresses[5] + 6),
        )
    _exert(P, tau, numbers(data, structs.QFRC_PASSIVE, dof, 6))


@jit
def _take(held: Array, tau: Array) -> None:
    """A held wrench stands on the left-hand side of the balance."""
    for i in range(6):
        tau[i] -= held[i]


@jit
def _stale(model: int, data: int, vehicle: Array) -> bool:
    """Whether MuJoCo's M may hold a vehicle's added inertia already, as where the velocity stage is repeated.

    The translational part of M is the body's mass times the identity, and the trace of the added part is the
    same at any attitude.
    """
    at, addresses = (
        int(vehicle[water.AT_INERTIA]),
        integers(model, structs.M_ROWADR, int(vehicle[water.AT_DOF]), 3),
    )
    added = vehicle[at] + vehicle[at + 7] + vehicle[at + 14]
    mass = numbers(model, structs.SUBTREE_MASS, int(vehicle[water.AT_BODY]), 1)[0]
    M = numbers(data, structs.M, 0, addresses[2] + 3)
    found = M[addresses[0]] + M[addresses[1] + 1] + M[addresses[2] + 2] - 3.0 * mass
    return bool(added < 1e-6 * mass or found > 0.5 * added)


def _passive(model: int, data: int) -> None:
    """`mjcb_passive`: all vehicles of a model."""
    count = field(model, structs.NNUMERIC)
    heavier = stale = False
    for index in range(count):
        vehicle = structs.vehicle_at(model, index)
        if vehicle.size and vehicle[water.AT_DOF] < 0.0:
            # Never prepared: let MuJoCo stop with its warning, not fly on without water.
            numbers(data, structs.QFRC_PASSIVE, 0, 1)[0] = np.nan
            return
        if vehicle.size and vehicle[water.AT_INERTIA] > 0.0:
            heavier = True
            stale = stale or _stale(model, data, vehicle)
    if stale:
        _mj_makeM(model, data)
    for index in range(count):
        vehicle = structs.vehicle_at(model, index)
        if vehicle.size:
            _add_forces(model, data, vehicle)
    if heavier:
        _mj_factorM(model, data)


@jit
def _delay_commands(model: int, data: int, vehicle: Array) -> None:
    """Fix the delayed commands of this step.

    Under RK4 the last stage of a step has the time of the next one's first, so a delay by time alone would
    let it see the next command.  Delays are rounded to whole steps.
    """
    program, first = structs.program_of(vehicle), int(vehicle[water.AT_ACTUATOR])
    read = number(data, structs.TIME) + 0.5 * number(model, structs.TIMESTEP)
    room = stack()
    for actuator in range(first, first + int(program[THRUSTER_COUNT])):
        if numbers(model, structs.DELAY, actuator, 1)[0] > 0.0:
            found = _mj_readCtrl(model, data, np.int32(actuator), read, as_doubles(room), np.int32(0))
            command = carray(pointer(found), (1,), np.float64) if found else carray(room, (1,), np.float64)
            numbers(data, structs.ACT, structs.last_activation(model, actuator) - 1, 1)[0] = command[0]


@jit
def _begin(model: int, data: int, vehicle: Array) -> None:
    """Fix delayed commands, set internal states at the start, and begin a control step where one is due."""
    if vehicle[water.AT_DELAYED] > 0.0:
        _delay_commands(model, data, vehicle)
    started = int(vehicle[water.AT_STARTED])
    if started < 0:
        return
    flag = numbers(data, structs.ACT, started, 1)
    block = vehicle[int(vehicle[water.AT_CONTROL]) :]
    time = number(data, structs.TIME)
    states = structs.control_states(data, vehicle)
    renew = states.size > 0 and control.due(block, states, time)
    if flag[0] != 0.0 and not renew:
        return
    room = carray(stack(), (ROOM,), np.float64)
    P, s = room[0:9].reshape(3, 3), room[S]
    _observe(data, vehicle, P, s)
    program = structs.program_of(vehicle)
    if flag[0] == 0.0:
        flag[0] = 1.0
        if vehicle[water.AT_EFFECTS] > 0.0 and program[STATE_COUNT] > 0.0:
            start(
                program,
                s,
                numbers(data, structs.ACT, int(vehicle[water.AT_STATES]), int(program[STATE_COUNT])),
            )
    if renew:
        packed = block[int(block[control.AT_WEIGHTS]) :]
        weights = carray(pointer(packed.ctypes.data), (int(block[control.AT_WEIGHT_COUNT]),), np.float32)
        control.control_kernel(block, weights, states, time, _felt(vehicle, s))


def _sensor(model: int, data: int, _stage: int) -> None:
    """`mjcb_sensor`: what happens once per step."""
    for index in range(field(model, structs.NNUMERIC)):
        vehicle = structs.vehicle_at(model, index)
        if vehicle.size and vehicle[water.AT_DOF] >= 0.0:
            _begin(model, data, vehicle)


@jit
def _internal_rates(model: int, data: int, actuator: int) -> None:
    """Write the rates of the internal states of a vehicle, which this actuator carries."""
    vehicle = numbers(model, structs.NUMERIC_DATA, structs.vehicle_address(model, actuator), structs.WHOLE)
    program, at = structs.program_of(vehicle), int(vehicle[water.AT_STATES])
    count = int(program[STATE_COUNT])
    room = carray(stack(), (ROOM,), np.float64)
    s, tau = room[S], room[TAU]
    _observe(data, vehicle, room[0:9].reshape(3, 3), s)
    wrench(program, s, numbers(data, structs.ACT, at, count), numbers(data, structs.ACT_DOT, at, count), tau)


@jit
def lag_share(row: Array, step: float) -> float:
    """Mean rate [1/s] of a lag over a time step, as a share of the distance to the settled state."""
    return (1.0 - lag_decay(row, step)) / step


def _rate(model: int, data: int, actuator: int) -> float:
    """`mjcb_act_dyn`: rate of a thruster's lag state.

    Under RK4 its derivative.  The other integrators add `rate * timestep`, so they get the mean rate over the
    step, which makes the lag exact for a held command.
    """
    prm = numbers(model, structs.BIASPRM, structs.NBIAS * actuator, structs.NBIAS)
    if prm[structs.PRM_MAGIC] != water.MAGIC:
        return 0.0
    if prm[structs.PRM_CARRIES] > 0.0:
        _internal_rates(model, data, actuator)
    row = structs.thruster_row(model, actuator)
    if row.size == 0 or row[TIME_CONSTANT] <= row[LAG_STEP]:
        return 0.0
    last = structs.last_activation(model, actuator)
    state, command = numbers(data, structs.ACT, last, 1)[0], structs.command_of(model, data, actuator)
    if carray(pointer(model + structs.INTEGRATOR), (1,), np.int32)[0] == structs.RK4:
        rate = state_derivative(row, state, command)
    else:
        step = number(model, structs.TIMESTEP)
        share = prm[structs.PRM_SHARE] if step == prm[structs.PRM_STEP] else lag_share(row, step)
        rate = (settled_state(row, command) - state) * share
    numbers(data, structs.ACT_DOT, last, 1)[0] = rate
    return rate


def _thrust(model: int, data: int, actuator: int) -> float:
    """`mjcb_act_bias`: thrust [N] of a thruster.

    Under Euler and implicitfast it is that of the lag state at the start of the step.  Stonefish moves its
    rotors before its body in each Euler tick, so that there it is that of the lag state at the end of it:
    one step earlier than here.
    """
    row = structs.thruster_row(model, actuator)
    if row.size == 0:
        return 0.0
    if row[TIME_CONSTANT] > row[LAG_STEP]:
        state = numbers(data, structs.ACT, structs.last_activation(model, actuator), 1)[0]
    else:
        state = advance_state(row, 0.0, structs.command_of(model, data, actuator), 0.0)
    inflow = 0.0
    if row[INFLOW] != 0.0:
        room = carray(stack(), (ROOM,), np.float64)
        vehicle = numbers(
            model, structs.NUMERIC_DATA, structs.vehicle_address(model, actuator), structs.WHOLE
        )
        s = room[S]
        _observe(data, vehicle, room[0:9].reshape(3, 3), s)
        inflow = inflow_speed(row, s[layout.RELATIVE_VELOCITY : layout.RELATIVE_VELOCITY + 6])
    return state_to_thrust(row, state, inflow)


def compile_callbacks() -> dict[str, Any]:
    """The callbacks by the names of MuJoCo's pointers to them; LLVM must know all `FUNCTIONS`."""
    struct, place = types.intp, types.int32
    return {
        "mjcb_passive": cfunc(types.void(struct, struct))(_passive),
        "mjcb_sensor": cfunc(types.void(struct, struct, place))(_sensor),
        "mjcb_act_dyn": cfunc(types.float64(struct, struct, place))(_rate),
        "mjcb_act_bias": cfunc(types.float64(struct, struct, place))(_thrust),
    }
