"""Installation of hydro's compiled callbacks in MuJoCo, and preparation of models with vehicles.

Every `mj_step`, `mujoco.batch.Batch` and `mujoco.rollout` of the process calls the callbacks
(`sim.bridge.callbacks`).  They run without the GIL and ignore models without a vehicle of hydro.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import mujoco
import numpy as np

from hydro.core.effects.program import STATE_COUNT, THRUSTER_COUNT, THRUSTER_TABLE
from hydro.core.errors import DataError, HydroError
from hydro.core.vehicle.thrusters import COLUMNS, LAG_STEP, TIME_CONSTANT
from hydro.sim.bridge import callbacks, fields, structs, water
from hydro.sim.bridge.inertia import is_packed
from hydro.sim.bridge.water import PREFIX
from hydro.sim.residual import control


def prepare(model: mujoco.MjModel) -> mujoco.MjModel:
    """Make a compiled MuJoCo model ready to step: install the callbacks, and store each vehicle's addresses.

    The constants with which MuJoCo scales contacts (`body_invweight0`, `dof_invweight0`) are recomputed with
    the added mass. Call this function again after `mj_setConst`, which ignores added mass.

    Args:
        model: Compiled model, changed in place.  A model without vehicles of hydro stays as it is.

    Returns:
        The same model.

    Raises:
        DataError: A setting of the model would make MuJoCo skip the callback, or solve contacts without added
            mass.
        HydroError: The installed MuJoCo is not the supported one.
    """
    names = [model.numeric(i).name for i in range(model.nnumeric)]
    vehicles = [name.removeprefix(PREFIX) for name in names if name.startswith(PREFIX)]
    if not vehicles:
        return model
    install()
    _refuse_settings(model)
    for name in vehicles:
        _write_addresses(model, name)
    if any(model.numeric(PREFIX + name).data[water.AT_INERTIA] for name in vehicles):
        _recompute_weights(model)
    return model


def _refuse_settings(model: mujoco.MjModel) -> None:
    """Refuse options with which MuJoCo skips a callback or calls it too late."""
    off = model.opt.disableflags
    both = int(mujoco.mjtDisableBit.mjDSBL_SPRING) | int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
    if off & both == both:
        raise DataError(
            "model: springs and dampers are both disabled, so MuJoCo skips all passive forces; enable one"
        )
    if off & int(mujoco.mjtDisableBit.mjDSBL_SENSOR):
        raise DataError("model: sensors are disabled, but hydro needs them once per step; enable them")
    if model.opt.solver == mujoco.mjtSolver.mjSOL_PGS or model.opt.noslip_iterations > 0:
        raise DataError("model: the PGS and noslip solvers ignore added mass; use the Newton or CG solver")


def _write_addresses(model: mujoco.MjModel, name: str) -> None:
    """Store the addresses of a vehicle's body, velocity and states in its numeric field.

    The actuators of the vehicle get the address of the field.
    """
    field = model.numeric(PREFIX + name)
    data = np.array(field.data)
    if data[water.AT_MAGIC] != water.MAGIC or data[water.AT_VERSION] != water.VERSION:
        raise DataError(
            f"model: vehicle {name} was written by another version of hydro; build the model again"
        )
    body, dof = _free_body(model, name, needs_room=bool(data[water.AT_INERTIA]))
    data[[water.AT_BODY, water.AT_DOF, water.AT_ROWS]] = body, dof, model.M_rowadr[dof]
    data[water.AT_ALONE] = float(not (model.dof_parentid[dof + 6 :] == dof + 5).any())
    if data[water.AT_HELD] >= 0 and data[water.AT_HELD] + 6 > model.nuserdata:
        raise DataError(
            f"model: nuserdata = {model.nuserdata} leaves no room for the held wrench of vehicle {name}"
        )
    program = int(data[water.AT_PROGRAM])
    address, step = int(model.numeric_adr[field.id]), float(model.opt.timestep)
    actuators = [i for i in range(model.nactuator) if model.actuator(i).name.startswith(f"{name}/")]
    thrusters = actuators if data[program + THRUSTER_COUNT] else []  # else it only carries states
    if len(thrusters) != data[program + THRUSTER_COUNT]:
        raise DataError(f"model: vehicle {name} has lost thrusters; build the model again")
    table = address + program + int(data[program + THRUSTER_TABLE])
    states = int(data[program + STATE_COUNT])
    for actuator in actuators:
        prm = model.actuator_biasprm[actuator]
        prm[[structs.PRM_MAGIC, structs.PRM_VEHICLE]] = water.MAGIC, address
        prm[structs.PRM_CARRIES] = float(states > 0 and actuator == actuators[0])
        prm[structs.PRM_THRUSTER], prm[structs.PRM_LAGS] = water.UNKNOWN, 0.0
        if actuator in thrusters:
            at = table + thrusters.index(actuator) * COLUMNS
            row = model.numeric_data[at : at + COLUMNS]
            prm[structs.PRM_THRUSTER] = at
            prm[[structs.PRM_STEP, structs.PRM_SHARE]] = step, callbacks.lag_share(row, step)
            last = model.actuator_actadr[actuator] + model.actuator_actnum[actuator] - 1
            prm[structs.PRM_STATE] = last if model.actuator_actnum[actuator] else water.UNKNOWN
            prm[structs.PRM_CONTROL] = model.actuator_ctrladr[actuator]
            prm[structs.PRM_LAGS] = float(row[TIME_CONSTANT] > row[LAG_STEP])
            prm[structs.PRM_DELAYED] = float(model.actuator_delay[actuator] > 0.0)
    data[water.AT_ACTUATOR] = thrusters[0] if thrusters else water.UNKNOWN
    if states or data[water.AT_CONTROL]:
        first = int(model.actuator_actadr[actuators[0]])
        block = int(data[water.AT_CONTROL])
        controls = int(data[block + control.AT_STATES]) if block else 0
        data[water.AT_STATES], data[water.AT_CONTROL_STATES] = first, first + states
        data[water.AT_STARTED] = first + states + controls
    field.data[:] = data


def _free_body(model: mujoco.MjModel, name: str, *, needs_room: bool) -> tuple[int, int]:
    """Return a vehicle's body and first degree of freedom; check the storage of M if `needs_room`."""
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if body < 0:
        raise DataError(f"model: numeric field {PREFIX}{name} names no body of the model")
    joint = model.body_jntadr[body]
    if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
        raise DataError(f"model: body {name} needs a free joint to be a vehicle in water")
    dof = int(model.jnt_dofadr[joint])
    rows = slice(dof, dof + 6)
    if needs_room and not is_packed(model.M_rowadr[rows], model.M_rownnz[rows]):
        raise DataError(f"model: MuJoCo stores no full 6x6 inertia for {name}; weld a small body to it")
    return body, dof


def _recompute_weights(model: mujoco.MjModel) -> None:
    """Recompute the inverse weights at the reference pose with the added mass, as `mj_setConst` does."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    inverse = np.linalg.inv(mass)
    for body in range(1, model.nbody):
        if model.body_weldid[body] == 0:
            continue
        jacobian = np.zeros((6, model.nv))
        mujoco.mj_jacBodyCom(model, data, jacobian[:3], jacobian[3:], body)
        mobility = np.einsum("ij,jk,ik->i", jacobian, inverse, jacobian)
        model.body_invweight0[body] = mobility[:3].mean(), mobility[3:].mean()
    for joint in range(model.njnt):
        dof = model.jnt_dofadr[joint]
        kind = model.jnt_type[joint]
        groups = {mujoco.mjtJoint.mjJNT_FREE: (3, 3), mujoco.mjtJoint.mjJNT_BALL: (3,)}.get(kind, (1,))
        for length in groups:
            model.dof_invweight0[dof : dof + length] = np.diag(inverse)[dof : dof + length].mean()
            dof += length


@cache
def install() -> None:
    """Install hydro's callbacks in MuJoCo, once in this process.

    Raises:
        HydroError: The installed MuJoCo is not the supported one, or other callbacks are installed.
    """
    fields.verify({"mjModel": structs.MODEL_FIELDS, "mjData": structs.DATA_FIELDS})
    library = _library()
    for name in callbacks.FUNCTIONS:
        llvm.add_symbol(name, ctypes.cast(getattr(library, name), ctypes.c_void_p).value)
    for name, callback in callbacks.compile_callbacks().items():
        slot = ctypes.c_void_p.in_dll(library, name)
        if slot.value:
            raise HydroError(f"another {name} is installed in MuJoCo; remove it before using hydro's")
        slot.value = callback.address
        _installed.append(callback)


_installed: list[Any] = []
"""References that keep the callbacks alive: MuJoCo holds bare pointers to them."""


@cache
def _library() -> ctypes.CDLL:
    """Return the MuJoCo library that this process already uses."""
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll"):
        for path in sorted(folder.glob(pattern)):
            return ctypes.CDLL(str(path))
    raise HydroError(f"no MuJoCo library in {folder}; install mujoco 4.0 with pip")
