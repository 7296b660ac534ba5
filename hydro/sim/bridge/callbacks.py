"""Compiled MuJoCo callbacks for vehicles in water, without Python, the GIL or memory between calls.

nu is the FRD velocity of CO, T maps MuJoCo's velocity to it (`T qvel = nu`), and nu_r is the velocity through
the water.  For each vehicle, `passive` adds::

    M            += T^T I T                                          added mass is inertia, not feedback
    qfrc_passive += T^T (I [omega x v_r; 0] - C(nu_r) nu_r + C_cancelled(nu) nu + effects - tau_held)

nu_r replaces nu in C_cancelled and in the network if the network learnt in still water (`water.residual`).
[omega x v_r; 0] is needed for two reasons (`simulation.dynamics`).  MuJoCo's linear acceleration is the
derivative in world axes, and a current that is steady in the world rotates in the body frame.

`sensor` runs once per step on the state at its start: it starts control steps and initialises internal
states.  `rate` is the lag of a thruster.  `thrust` is its thrust if this is not just proportional to the lag
state.  The kernels are those of `core`, as in `simulation.simulate`.  Parameters are in numeric fields
(`sim.bridge.water`) and states in activations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from hydro.core.columns import Array
from hydro.core.compiled import cfunc, jit, kernel, within
from hydro.core.effects import layout
from hydro.core.effects.program import STATE_COUNT, THRUSTER_COUNT, rates, relative_to_water, start, wrench
from hydro.core.vehicle.frames import HALF_TURN
from hydro.core.vehicle.rigid_body import coriolis_kernel
from hydro.core.vehicle.thrusters import (
    COLUMNS,
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
from hydro.sim.bridge.inertia import ENTRIES, add_inertia, factor, stale
from hydro.sim.bridge.pointers import (
    as_doubles,
    choice,
    field,
    integers,
    number,
    numbers,
    part,
    singles,
    stack,
)
from hydro.sim.bridge.structs import (
    command_of,
    control_states,
    last_activation,
    parameters_of,
    program_of,
    thruster_row,
    vehicle_at,
)
from hydro.sim.residual import control

_mj_factorM = types.ExternalFunction("mj_factorM", types.void(types.intp, types.intp))
_mj_makeM = types.ExternalFunction("mj_makeM", types.void(types.intp, types.intp))
_mj_readCtrl = types.ExternalFunction(
    "mj_readCtrl",
    types.intp(
        types.intp, types.intp, types.int32, types.float64, types.CPointer(types.float64), types.int32
    ),
)
S = 9
"""Index of the state of motion in the stack buffer, after a rotation."""
TAU, SCRATCH = S + layout.MOTION, S + layout.MOTION + 6
"""Indices of a wrench and of scratch space after it."""
FUNCTIONS = ("mj_factorM", "mj_makeM", "mj_readCtrl")


@within
def _write_motion(data: int, vehicle: Array, P: Array, s: Array) -> None:
    """Write a vehicle's state of motion into `s`, and the rotation from z-up world to FRD into P (9,).

    The layout of `s` is that of `core.effects.layout`.
    """
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
            P[3 * i + j] = here * xmat[3 * j + i]
            s[layout.ROTATION + 3 * i + j] = here * there * xmat[3 * i + j]
        s[layout.POSITION + i] = here * xpos[i]
        s[layout.VELOCITY + 3 + i] = here * qvel[3 + i]
    for i in range(3):
        s[layout.VELOCITY + i] = P[3 * i] * qvel[0] + P[3 * i + 1] * qvel[1] + P[3 * i + 2] * qvel[2]
    relative_to_water(program_of(vehicle), s)


@within
def _write_commands(model: int, data: int, vehicle: Array, s: Array) -> None:
    """Write the commands of this step into `s`, before any delay."""
    count = min(int(program_of(vehicle)[THRUSTER_COUNT]), layout.MOST_COMMANDS)
    if count:
        first = integers(model, structs.CTRLADR, int(vehicle[water.AT_ACTUATOR]), 1)[0]
        given = numbers(data, structs.CTRL, first, count)
        for i in range(count):
            s[layout.COMMANDS + i] = given[i]


@within
def _network_input(vehicle: Array) -> int:
    """Return the index of the residual network's velocity input in the state of motion.

    The input is the velocity over ground or through the water.
    """
    return layout.RELATIVE_VELOCITY if vehicle[water.AT_DRIFTING] > 0.0 else layout.VELOCITY


@within
def _add_body_wrench(P: Array, tau: Array, force: Array) -> None:
    """Add a body wrench tau (6,) [N, N m], FRD about CO, to MuJoCo's generalised force `force` (6,).

    The result is force + T^T tau, where T maps MuJoCo's velocity to nu and P (9,) is its translational part.
    """
    for j in range(3):
        force[j] += P[j] * tau[0] + P[3 + j] * tau[1] + P[6 + j] * tau[2]
    force[3] += tau[3]
    force[4] -= tau[4]
    force[5] -= tau[5]


@within
def _add_transport(A: Array, nu: Array, tau: Array) -> None:
    """Add A [omega x v; 0] to `tau` (6,), for an inertia A (36,), row by row, and nu = (v, omega)."""
    x = nu[4] * nu[2] - nu[5] * nu[1]
    y = nu[5] * nu[0] - nu[3] * nu[2]
    z = nu[3] * nu[1] - nu[4] * nu[0]
    for i in range(6):
        tau[i] += A[6 * i] * x + A[6 * i + 1] * y + A[6 * i + 2] * z


@within
def _add_coriolis(A: Array, factor: float, nu: Array, part: Array, tau: Array) -> None:
    """Add factor C(nu) nu to `tau` (6,), with the Coriolis matrix C of an inertia A (36,), row by row.

    `part` (6,) is overwritten.
    """
    for i in range(6):
        part[i] = 0.0
    coriolis_kernel(A, nu, part)
    for i in range(6):
        tau[i] += factor * part[i]


@within
def _add_to_mass(data: int, vehicle: Array, P: Array, scratch: Array) -> bool:
    """Add one vehicle's inertia to MuJoCo's mass matrix M; return whether its rows were factored again."""
    at, rows, dof = (
        int(vehicle[water.AT_INERTIA]),
        int(vehicle[water.AT_ROWS]),
        int(vehicle[water.AT_DOF]),
    )
    M = numbers(data, structs.M, rows, ENTRIES)
    add_inertia(part(vehicle, at, 36), P, scratch, M)
    if vehicle[water.AT_ALONE] == 0.0:
        return False
    return factor(
        M,
        numbers(data, structs.FACTORED_M, rows, ENTRIES),
        numbers(data, structs.INVERSE_D, dof, 6),
    )


@within
def _add_forces(model: int, data: int, vehicle: Array) -> bool:
    """Add one vehicle's inertia and forces; return whether MuJoCo's M was factored including the inertia."""
    room = stack()
    P, s, tau, scratch = (
        part(room, 0, 9),
        part(room, S, layout.MOTION),
        part(room, TAU, 6),
        part(room, SCRATCH, 18),
    )
    _write_motion(data, vehicle, P, s)
    # First: its divisions depend only on one another, so the processor can overlap them with the rest.
    factored = _add_to_mass(data, vehicle, P, scratch) if vehicle[water.AT_INERTIA] > 0.0 else True
    for i in range(6):
        tau[i] = 0.0
    nu_r, felt = part(s, layout.RELATIVE_VELOCITY, 6), part(s, _network_input(vehicle), 6)
    dof = int(vehicle[water.AT_DOF])

    if vehicle[water.AT_EFFECTS] > 0.0:
        program, at = program_of(vehicle), int(vehicle[water.AT_STATES])
        _write_commands(model, data, vehicle, s)
        count = int(program[STATE_COUNT])
        # MuJoCo clears `act_dot` after this stage: the rates written here are discarded.
        wrench(
            program, s, numbers(data, structs.ACT, at, count), numbers(data, structs.ACT_DOT, at, count), tau
        )
    at = int(vehicle[water.AT_CORIOLIS])
    if at:
        _add_coriolis(part(vehicle, at, 36), -1.0, nu_r, scratch, tau)
    at = int(vehicle[water.AT_CANCELLED])
    if at:
        _add_coriolis(part(vehicle, at, 36), 1.0, felt, scratch, tau)
    at = int(vehicle[water.AT_HELD])
    if at >= 0:
        _subtract_held(numbers(data, structs.USERDATA, at, 6), tau)
    if vehicle[water.AT_CONTROL] > 0.0:
        block = part(vehicle, int(vehicle[water.AT_CONTROL]), structs.WHOLE)
        control.exert(block, control_states(data, vehicle), felt, scratch, tau)
    at = int(vehicle[water.AT_INERTIA])
    if at:
        _add_transport(part(vehicle, at, 36), nu_r, tau)
    _add_body_wrench(P, tau, numbers(data, structs.QFRC_PASSIVE, dof, 6))
    return factored


@within
def _subtract_held(held: Array, tau: Array) -> None:
    """Subtract the wrench that a residual network holds for a control step from `tau`, in place.

    Args:
        held: Held wrench (6,), on the left-hand side of the equations of motion.
        tau: Wrench on the right-hand side (6,).
    """
    for i in range(6):
        tau[i] -= held[i]


@within
def _has_added_mass(model: int, data: int, vehicle: Array) -> bool:
    """Return whether MuJoCo's mass matrix M may already contain a vehicle's added inertia."""
    mass = numbers(model, structs.SUBTREE_MASS, int(vehicle[water.AT_BODY]), 1)[0]
    A = part(vehicle, int(vehicle[water.AT_INERTIA]), 36)
    return stale(A, mass, numbers(data, structs.M, int(vehicle[water.AT_ROWS]), ENTRIES))


def _passive(model: int, data: int) -> None:
    """Compute `mjcb_passive` for all vehicles of a model."""
    count = field(model, structs.NNUMERIC)
    made = True
    for index in range(count):
        vehicle = vehicle_at(model, index)
        if vehicle.size and (vehicle[water.AT_DOF] < 0.0 or vehicle[water.AT_VERSION] != water.VERSION):
            # The model was not prepared: NaN makes MuJoCo stop with a warning instead of simulating dry.
            numbers(data, structs.QFRC_PASSIVE, 0, 1)[0] = np.nan
            return
        if vehicle.size and vehicle[water.AT_INERTIA] > 0.0 and _has_added_mass(model, data, vehicle):
            made = False
    if not made:
        _mj_makeM(model, data)
    factored = True
    for index in range(count):
        vehicle = vehicle_at(model, index)
        if vehicle.size and not _add_forces(model, data, vehicle):
            factored = False
    if not factored:
        _mj_factorM(model, data)


@within
def _delay_commands(model: int, data: int, vehicle: Array) -> None:
    """Set the delayed commands of this step.

    Under RK4, the last stage of a step has the time of the next step's first stage.  If delays were applied
    by time alone, this stage would see the next command, so delays are rounded to whole steps.
    """
    program, first = program_of(vehicle), int(vehicle[water.AT_ACTUATOR])
    read = number(data, structs.TIME) + 0.5 * number(model, structs.TIMESTEP)
    room = stack()
    for actuator in range(first, first + int(program[THRUSTER_COUNT])):
        if numbers(model, structs.DELAY, actuator, 1)[0] > 0.0:
            found = _mj_readCtrl(model, data, np.int32(actuator), read, as_doubles(room), np.int32(0))
            command = number(found, 0) if found else room[0]
            numbers(data, structs.ACT, last_activation(model, actuator) - 1, 1)[0] = command


@jit
def _begin(data: int, vehicle: Array, renew: bool) -> None:
    """Initialise internal states before the first step, and start a control step if `renew` is true."""
    room = stack()
    P, s = part(room, 0, 9), part(room, S, layout.MOTION)
    _write_motion(data, vehicle, P, s)
    flag = numbers(data, structs.ACT, int(vehicle[water.AT_STARTED]), 1)
    if flag[0] == 0.0:
        flag[0] = 1.0
        program = program_of(vehicle)
        if vehicle[water.AT_EFFECTS] > 0.0 and program[STATE_COUNT] > 0.0:
            start(
                program,
                s,
                numbers(data, structs.ACT, int(vehicle[water.AT_STATES]), int(program[STATE_COUNT])),
            )
    if renew:
        block = part(vehicle, int(vehicle[water.AT_CONTROL]), structs.WHOLE)
        weights = singles(block, int(block[control.AT_WEIGHTS]), int(block[control.AT_WEIGHT_COUNT]))
        control.control_kernel(
            block,
            weights,
            control_states(data, vehicle),
            number(data, structs.TIME),
            part(s, _network_input(vehicle), 6),
        )


def _sensor(model: int, data: int, _stage: int) -> None:
    """Do the work of `mjcb_sensor`, once per step.

    It sets delayed commands, initialises internal states at the start, and starts due control steps.
    """
    for index in range(field(model, structs.NNUMERIC)):
        vehicle = vehicle_at(model, index)
        if vehicle.size == 0 or vehicle[water.AT_DOF] < 0.0 or vehicle[water.AT_VERSION] != water.VERSION:
            continue
        if vehicle[water.AT_DELAYED] > 0.0:
            _delay_commands(model, data, vehicle)
        if vehicle[water.AT_STARTED] < 0.0:
            continue
        flag = numbers(data, structs.ACT, int(vehicle[water.AT_STARTED]), 1)[0]
        renew = False
        if vehicle[water.AT_CONTROL] > 0.0:
            block = part(vehicle, int(vehicle[water.AT_CONTROL]), structs.WHOLE)
            renew = control.due(block, control_states(data, vehicle), number(data, structs.TIME))
        if flag == 0.0 or renew:
            _begin(data, vehicle, renew)


@kernel
def _internal_rates(data: int, vehicle: Array) -> None:
    """Write the time derivatives of the internal states of a vehicle's effects into `mjData.act_dot`."""
    program, at = program_of(vehicle), int(vehicle[water.AT_STATES])
    count = int(program[STATE_COUNT])
    room = stack()
    s, tau = part(room, S, layout.MOTION), part(room, TAU, 6)
    _write_motion(data, vehicle, part(room, 0, 9), s)
    rates(program, s, numbers(data, structs.ACT, at, count), numbers(data, structs.ACT_DOT, at, count), tau)


@within
def lag_share(row: Array, step: float) -> float:
    """Return the rate at which a thruster's lag state approaches its steady value, averaged over a step.

    Args:
        row: Row of the thruster table, (columns,).
        step: Time step [s].

    Returns:
        Change of the state per second, as a fraction of the distance to the steady value [1/s].
    """
    return (1.0 - lag_decay(row, step)) / step


def _rate(model: int, data: int, actuator: int) -> float:
    """Return the rate of a thruster's lag state (`mjcb_act_dyn`).

    Under RK4 it is the derivative.  Other integrators add `rate * timestep`, so they get the mean rate over
    the step, which makes the lag exact for a held command.
    """
    prm = parameters_of(model, actuator)
    if prm[structs.PRM_MAGIC] != water.MAGIC:
        return 0.0
    if prm[structs.PRM_CARRIES] > 0.0:
        _internal_rates(
            data, numbers(model, structs.NUMERIC_DATA, int(prm[structs.PRM_VEHICLE]), structs.WHOLE)
        )
    if prm[structs.PRM_LAGS] == 0.0:
        return 0.0
    row = numbers(model, structs.NUMERIC_DATA, int(prm[structs.PRM_THRUSTER]), COLUMNS)
    last = int(prm[structs.PRM_STATE])
    state, command = numbers(data, structs.ACT, last, 1)[0], command_of(data, prm)
    if choice(model, structs.INTEGRATOR) == structs.RK4:
        rate = state_derivative(row, state, command)
    else:
        step = number(model, structs.TIMESTEP)
        share = prm[structs.PRM_SHARE] if step == prm[structs.PRM_STEP] else lag_share(row, step)
        rate = (settled_state(row, command) - state) * share
    numbers(data, structs.ACT_DOT, last, 1)[0] = rate
    return rate


def _thrust(model: int, data: int, actuator: int) -> float:
    """Return the thrust of a thruster [N] (`mjcb_act_bias`).

    Under Euler and implicitfast it follows from the lag state at the start of the step.  Stonefish moves its
    rotors before its body in each Euler tick, so there it follows from the lag state at the end of the tick,
    one step earlier than here.
    """
    prm = parameters_of(model, actuator)
    row = thruster_row(model, prm)
    if row.size == 0:
        return 0.0
    if row[TIME_CONSTANT] > row[LAG_STEP]:
        state = numbers(data, structs.ACT, int(prm[structs.PRM_STATE]), 1)[0]
    else:
        state = advance_state(row, 0.0, command_of(data, prm), 0.0)
    inflow = 0.0
    if row[INFLOW] != 0.0:
        room = stack()
        vehicle = numbers(model, structs.NUMERIC_DATA, int(prm[structs.PRM_VEHICLE]), structs.WHOLE)
        s = part(room, S, layout.MOTION)
        _write_motion(data, vehicle, part(room, 0, 9), s)
        inflow = inflow_speed(row, part(s, layout.RELATIVE_VELOCITY, 6))
    return state_to_thrust(row, state, inflow)


def compile_callbacks() -> dict[str, Any]:
    """Return the compiled callbacks as a dict by the names of MuJoCo's pointers to them.

    LLVM must know the addresses of all `FUNCTIONS`.
    """
    struct, place = types.intp, types.int32
    return {
        "mjcb_passive": cfunc(types.void(struct, struct), counted=False)(_passive),
        "mjcb_sensor": cfunc(types.void(struct, struct, place))(_sensor),
        "mjcb_act_dyn": cfunc(types.float64(struct, struct, place), counted=False)(_rate),
        "mjcb_act_bias": cfunc(types.float64(struct, struct, place), counted=False)(_thrust),
    }
