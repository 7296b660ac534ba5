"""Where a vehicle's numbers lie in MuJoCo's structs: its field, its states, and the rows of its thrusters.

A numeric field holds a vehicle's parameters (`sim.bridge.water`); an actuator's `biasprm` leads from a
thruster to its row and to its vehicle; activations hold the states.  Offsets of the structs' fields are found
at import.
"""

from __future__ import annotations

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.vehicle.thrusters import COLUMNS
from hydro.sim.bridge import water
from hydro.sim.bridge.fields import offset
from hydro.sim.bridge.pointers import integers, numbers
from hydro.sim.residual import control

MODEL_FIELDS = (
    "opt.timestep",
    "opt.integrator",
    "nnumeric",
    "numeric_adr",
    "numeric_size",
    "numeric_data",
    "M_rownnz",
    "M_rowadr",
    "body_subtreemass",
    "actuator_ctrladr",
    "actuator_actadr",
    "actuator_actnum",
    "actuator_biasprm",
    "actuator_delay",
)
DATA_FIELDS = ("time", "qvel", "xpos", "xmat", "M", "qfrc_passive", "act", "act_dot", "ctrl", "userdata")

TIMESTEP, INTEGRATOR, NNUMERIC, NUMERIC_ADR, NUMERIC_SIZE, NUMERIC_DATA = (
    offset("mjModel", name) for name in MODEL_FIELDS[:6]
)
M_ROWNNZ, M_ROWADR, SUBTREE_MASS, CTRLADR, ACTADR, ACTNUM, BIASPRM, DELAY = (
    offset("mjModel", name) for name in MODEL_FIELDS[6:]
)
TIME, QVEL, XPOS, XMAT, M, QFRC_PASSIVE, ACT, ACT_DOT, CTRL, USERDATA = (
    offset("mjData", name) for name in DATA_FIELDS
)
RK4 = 1  # mjINT_RK4
NBIAS = 10  # mjNBIAS

# What `prepare` writes into a thruster's `biasprm`.
PRM_MAGIC, PRM_VEHICLE = 0, 1  # ..., address of the vehicle's field
PRM_THRUSTER = 2  # address of the thruster's row; -1 for an actuator that only carries states
PRM_CARRIES = 3  # 1 where this actuator carries its vehicle's internal states
PRM_STEP, PRM_SHARE = 4, 5  # a time step [s] and what `lag_share` is for it

WHOLE = 1 << 30  # length of a view whose end is known from within


@jit
def vehicle_at(model: int, index: int) -> Array:
    """Parameters in the numeric field `index`; none (length 0) where it is not of hydro."""
    adr = integers(model, NUMERIC_ADR, index, 1)[0]
    length = integers(model, NUMERIC_SIZE, index, 1)[0]
    found = numbers(model, NUMERIC_DATA, adr, length)
    return found if length >= water.HEADER and found[water.AT_MAGIC] == water.MAGIC else found[:0]


@jit
def program_of(vehicle: Array) -> Array:
    """The compiled effects and thrusters of a vehicle."""
    return vehicle[int(vehicle[water.AT_PROGRAM]) :]


@jit
def control_states(data: int, vehicle: Array) -> Array:
    """States of the network's control, none (length 0) where there is none."""
    at = int(vehicle[water.AT_CONTROL])
    count = int(vehicle[at + control.AT_STATES]) if at else 0
    return numbers(data, ACT, int(vehicle[water.AT_CONTROL_STATES]), count)


@jit
def thruster_row(model: int, actuator: int) -> Array:
    """Row of the thruster table of an actuator; none (length 0) where it is not one of hydro's."""
    prm = numbers(model, BIASPRM, NBIAS * actuator, NBIAS)
    if prm[PRM_MAGIC] != water.MAGIC or prm[PRM_THRUSTER] < 0.0:
        return prm[:0]
    return numbers(model, NUMERIC_DATA, int(prm[PRM_THRUSTER]), COLUMNS)


@jit
def last_activation(model: int, actuator: int) -> int:
    """Address of a thruster's lag state; a delayed command stands before it."""
    return int(integers(model, ACTADR, actuator, 1)[0] + integers(model, ACTNUM, actuator, 1)[0] - 1)


@jit
def given_command(model: int, data: int, actuator: int) -> float:
    """The command of a thruster as it is given in this step, before any delay."""
    return float(numbers(data, CTRL, integers(model, CTRLADR, actuator, 1)[0], 1)[0])


@jit
def command_of(model: int, data: int, actuator: int) -> float:
    """The command that a thruster obeys during this step."""
    if numbers(model, DELAY, actuator, 1)[0] > 0.0:
        return float(numbers(data, ACT, last_activation(model, actuator) - 1, 1)[0])
    return given_command(model, data, actuator)


@jit
def vehicle_address(model: int, actuator: int) -> int:
    """Where in the numeric data a thruster's vehicle begins."""
    return int(numbers(model, BIASPRM, NBIAS * actuator, NBIAS)[PRM_VEHICLE])
