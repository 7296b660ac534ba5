"""Layout of a vehicle's numbers in MuJoCo's structs: its field, its states, and its thruster rows.

A numeric field holds a vehicle's parameters (`sim.bridge.water`).  An actuator's `biasprm` has the addresses
of its thruster row and its vehicle.  Activations hold the states.  Offsets of the structs' fields are
determined at import.
"""

from __future__ import annotations

from hydro.core.columns import Array
from hydro.core.compiled import within
from hydro.core.vehicle.thrusters import COLUMNS
from hydro.sim.bridge import water
from hydro.sim.bridge.fields import offset
from hydro.sim.bridge.pointers import inlined, integers, numbers, part
from hydro.sim.residual import control

MODEL_FIELDS = (
    "opt.timestep",
    "opt.integrator",
    "nnumeric",
    "numeric_adr",
    "numeric_size",
    "numeric_data",
    "body_subtreemass",
    "actuator_ctrladr",
    "actuator_actadr",
    "actuator_actnum",
    "actuator_biasprm",
    "actuator_delay",
)
DATA_FIELDS = (
    "time",
    "qvel",
    "xpos",
    "xmat",
    "M",
    "qLD",
    "qLDiagInv",
    "qfrc_passive",
    "act",
    "act_dot",
    "ctrl",
    "userdata",
)

TIMESTEP, INTEGRATOR, NNUMERIC, NUMERIC_ADR, NUMERIC_SIZE, NUMERIC_DATA = (
    offset("mjModel", name) for name in MODEL_FIELDS[:6]
)
SUBTREE_MASS, CTRLADR, ACTADR, ACTNUM, BIASPRM, DELAY = (offset("mjModel", name) for name in MODEL_FIELDS[6:])
TIME, QVEL, XPOS, XMAT, M, FACTORED_M, INVERSE_D, QFRC_PASSIVE, ACT, ACT_DOT, CTRL, USERDATA = (
    offset("mjData", name) for name in DATA_FIELDS
)
RK4 = 1  # mjINT_RK4
NBIAS = 10  # mjNBIAS

# Entries of a thruster's `biasprm`, written by `prepare`.
PRM_MAGIC, PRM_VEHICLE = 0, 1  # ..., address of the vehicle's field
PRM_THRUSTER = 2  # address of the thruster's row; -1 for an actuator that only carries states
PRM_CARRIES = 3  # 1 if this actuator carries its vehicle's internal states
PRM_STEP, PRM_SHARE = 4, 5  # a time step [s] and its `lag_share`
PRM_STATE = 6  # index in `act` of its lag state; a delayed command precedes it
PRM_CONTROL = 7  # index in `ctrl` of its command before any delay
PRM_DELAYED = 8  # 1 if its command is delayed
PRM_LAGS = 9  # 1 if it has a lag

WHOLE = 1 << 30  # length of a view whose end is determined by its content


@inlined
def vehicle_at(model: int, index: int) -> Array:
    """Return a view of the parameters that a numeric field of a model holds; empty if hydro did not write it.

    Args:
        model: Address of the `mjModel`.
        index: Number of the numeric field.
    """
    length = integers(model, NUMERIC_SIZE, index, 1)[0]
    found = numbers(model, NUMERIC_DATA, integers(model, NUMERIC_ADR, index, 1)[0], length)
    own = length >= water.HEADER and found[water.AT_MAGIC] == water.MAGIC
    vehicle: Array = part(found, 0, length if own else 0)
    return vehicle


@inlined
def program_of(vehicle: Array) -> Array:
    """Return a view of the compiled effects and thrusters in a vehicle's parameters from `vehicle_at`."""
    program: Array = part(vehicle, int(vehicle[water.AT_PROGRAM]), WHOLE)
    return program


@inlined
def control_states(data: int, vehicle: Array) -> Array:
    """Return a view of those states in `mjData.act` that belong to a residual network.

    Empty without a network.

    Args:
        data: Address of the `mjData`.
        vehicle: Parameters of the vehicle, from `vehicle_at`.
    """
    at = int(vehicle[water.AT_CONTROL])
    count = int(vehicle[at + control.AT_STATES]) if at else 0
    states: Array = numbers(data, ACT, int(vehicle[water.AT_CONTROL_STATES]), count)
    return states


@inlined
def parameters_of(model: int, actuator: int) -> Array:
    """Return a view of the parameters (`biasprm`) of actuator number `actuator`, as written by `prepare`."""
    prm: Array = numbers(model, BIASPRM, NBIAS * actuator, NBIAS)
    return prm


@inlined
def thruster_row(model: int, prm: Array) -> Array:
    """Return a view of the thruster table's row for an actuator; empty if it is not a thruster of hydro.

    Args:
        model: Address of the `mjModel`.
        prm: Parameters of the actuator, from `parameters_of`.
    """
    own = prm[PRM_MAGIC] == water.MAGIC and prm[PRM_THRUSTER] >= 0.0
    row: Array = numbers(model, NUMERIC_DATA, int(prm[PRM_THRUSTER]) if own else 0, COLUMNS if own else 0)
    return row


@within
def last_activation(model: int, actuator: int) -> int:
    """Return the index in `mjData.act` of a thruster's lag state; a delayed command precedes it.

    Args:
        model: Address of the `mjModel`.
        actuator: Number of the actuator.
    """
    return int(integers(model, ACTADR, actuator, 1)[0] + integers(model, ACTNUM, actuator, 1)[0] - 1)


@inlined
def command_of(data: int, prm: Array) -> float:
    """Return the command that acts on a thruster during this step, after its delay.

    Args:
        data: Address of the `mjData`.
        prm: Parameters of the actuator, from `parameters_of`.
    """
    if prm[PRM_DELAYED] > 0.0:
        return float(numbers(data, ACT, int(prm[PRM_STATE]) - 1, 1)[0])
    return float(numbers(data, CTRL, int(prm[PRM_CONTROL]), 1)[0])
