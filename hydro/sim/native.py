"""What MuJoCo lacks of a vehicle in water, as a compiled callback at every substep.

MuJoCo integrates M_RB and C_RB of a body.  `mjcb_passive` here adds, for each vehicle that the model's numeric
fields describe, with nu the FRD velocity of CO and T the map from MuJoCo's velocity to nu (`T qvel = nu`)::

    M            += T^T M_A T                                  added mass is inertia, not feedback
    qfrc_passive += T^T (M_A [omega x v; 0] - C(nu) nu - tau_held)

where C is the Coriolis matrix of a second 6x6 matrix: M_A itself for the added mass of Fossen (2011, eq. 6.43), -M_RB where a
residual model brings all of C (paper eq. 5).  `tau_held` is a body-fixed wrench that the host holds in `userdata`: a residual
model's output on the left-hand side of the balance.  [omega x v; 0] is there because MuJoCo's linear acceleration is
the world's derivative.

The callback is machine code: it runs without the GIL under `mj_step`, `mujoco.batch.Batch` and `mujoco.rollout`, keeps
nothing between calls, and passes over models that carry no parameters of hydro.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import mujoco
import numpy as np
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from hydro.core import compiled
from hydro.core.errors import DataError, HydroError
from hydro.core.rigid_body import coriolis_kernel
from hydro.sim import fields

Array = NDArray[np.float64]

PREFIX = "hydro/"
"""A numeric field `hydro/<body>` holds the parameters of the vehicle whose body is `<body>`."""

# The header of a vehicle's parameters.  Entries are counts or positions, exact as doubles; a block at position 0 is absent.
MAGIC = 4.859381e17  # no numeric field of another's starts with it, and XML text keeps it
VERSION = 1.0
AT_MAGIC, AT_VERSION, AT_BODY, AT_DOF, AT_INERTIA, AT_CORIOLIS, AT_HELD = range(7)
HEADER = 16
_UNPREPARED = -1.0

_MODEL_FIELDS = ("nnumeric", "numeric_adr", "numeric_size", "numeric_data", "M_rownnz", "M_rowadr")
_DATA_FIELDS = ("qvel", "xmat", "M", "qfrc_passive", "userdata")

_NNUMERIC, _NUMERIC_ADR, _NUMERIC_SIZE, _NUMERIC_DATA, _M_ROWNNZ, _M_ROWADR = (
    fields.offset("mjModel", name) for name in _MODEL_FIELDS
)
_QVEL, _XMAT, _M, _QFRC_PASSIVE, _USERDATA = (fields.offset("mjData", name) for name in _DATA_FIELDS)


def parameters(
    *, inertia: Array | None = None, coriolis: Array | None = None, held: int | None = None
) -> Array:
    """One vehicle's parameters as the numeric field `hydro/<body>` carries them.

    Args:
        inertia: M_A (6, 6), body FRD about CO, symmetric: added to MuJoCo's mass matrix.
        coriolis: A symmetric (6, 6) matrix whose Coriolis wrench is exerted beside MuJoCo's own.
        held: Where in `userdata` the six entries of a held wrench begin.

    Returns:
        The field's data.
    """
    header = np.zeros(HEADER)
    header[[AT_MAGIC, AT_VERSION]] = MAGIC, VERSION
    header[[AT_BODY, AT_DOF]] = _UNPREPARED
    header[AT_HELD] = -1.0 if held is None else held
    blocks = [header]
    for entry, matrix in ((AT_INERTIA, inertia), (AT_CORIOLIS, coriolis)):
        if matrix is not None:
            header[entry] = sum(map(len, blocks))
            blocks.append(np.asarray(matrix, dtype=np.float64).ravel())
    return np.concatenate(blocks)


def attach(spec: mujoco.MjSpec, body: str, data: Array) -> None:
    """Give the vehicle `body` of a specification its parameters."""
    spec.add_numeric(name=PREFIX + body, data=data, size=len(data))


def prepare(model: mujoco.MjModel) -> mujoco.MjModel:
    """Make a compiled model ready to step: install the callback and tell it where each vehicle's velocity lies.

    The constants by which MuJoCo judges contacts (`body_invweight0`, `dof_invweight0`) are recomputed with the added mass in.
    Call it again after `mj_setConst`, which knows nothing of added mass.

    Args:
        model: A compiled model, changed in place.  Without numeric fields of hydro it stays as it is.

    Returns:
        The model.

    Raises:
        DataError: A setting of the model would make MuJoCo ignore the callback or solve contacts without added mass.
        HydroError: The installed MuJoCo differs from the one hydro knows.
    """
    names = [model.numeric(i).name for i in range(model.nnumeric)]
    vehicles = [name for name in names if name.startswith(PREFIX)]
    if not vehicles:
        return model
    install()
    _refuse_settings(model)
    for name in vehicles:
        _locate(model, name)
    _weigh(model)
    return model


def _refuse_settings(model: mujoco.MjModel) -> None:
    """Refuse options under which the callback is skipped or comes too late."""
    both = int(mujoco.mjtDisableBit.mjDSBL_SPRING) | int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
    if model.opt.disableflags & both == both:
        raise DataError(
            "model: springs and dampers are both disabled, so MuJoCo skips all passive forces; enable one"
        )
    if model.opt.solver == mujoco.mjtSolver.mjSOL_PGS or model.opt.noslip_iterations > 0:
        raise DataError(
            "model: the PGS and noslip solvers do not feel added mass; use the Newton or CG solver"
        )


def _locate(model: mujoco.MjModel, name: str) -> None:
    """Write body and degree of freedom into a vehicle's header, and check that its mass matrix has room for M_A."""
    field = model.numeric(name)
    if field.data[AT_MAGIC] != MAGIC or field.data[AT_VERSION] != VERSION:
        raise DataError(
            f"model: numeric field {name} was written by another version of hydro; build the model again"
        )
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name.removeprefix(PREFIX))
    if body < 0:
        raise DataError(f"model: numeric field {name} names no body; the name follows '{PREFIX}'")
    joint = model.body_jntadr[body]
    if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
        raise DataError(
            f"model: body {name.removeprefix(PREFIX)} needs a free joint to be a vehicle in water"
        )
    dof = model.jnt_dofadr[joint]
    if not np.array_equal(model.M_rownnz[dof : dof + 6], np.arange(1, 7)):
        raise DataError(f"model: MuJoCo stores no full 6x6 inertia for {name}; weld a small body to it")
    if field.data[AT_HELD] >= 0 and field.data[AT_HELD] + 6 > model.nuserdata:
        raise DataError(f"model: nuserdata = {model.nuserdata} leaves no room for the held wrench of {name}")
    data = field.data.copy()
    data[[AT_BODY, AT_DOF]] = body, dof
    field.data[:] = data


def _weigh(model: mujoco.MjModel) -> None:
    """Recompute the inverse weights at the reference pose (MuJoCo's `mj_setConst`) from the augmented mass matrix."""
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
    """Install the callback in this process, once.

    Raises:
        HydroError: The installed MuJoCo differs from the one hydro knows, or another passive callback is in place.
    """
    fields.verify({"mjModel": _MODEL_FIELDS, "mjData": _DATA_FIELDS})
    slot = ctypes.c_void_p.in_dll(_library(), "mjcb_passive")
    if slot.value:
        raise HydroError("another passive callback is installed in MuJoCo; remove it before using hydro's")
    slot.value = _passive().address


@cache
def _library() -> ctypes.CDLL:
    """The MuJoCo library that this process already uses."""
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll"):
        for path in sorted(folder.glob(pattern)):
            return ctypes.CDLL(str(path))
    raise HydroError(f"no MuJoCo library in {folder}; install mujoco 4.0 with pip")


# --- compiled from here on -----------------------------------------------------------------------------------

_mj_factorM = types.ExternalFunction("mj_factorM", types.void(types.intp, types.intp))
_mj_makeM = types.ExternalFunction("mj_makeM", types.void(types.intp, types.intp))


@intrinsic
def _pointer(_context: Any, address: Any) -> Any:
    """An address as a pointer."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.intp), generate


@compiled.jit
def _field(struct, offset):  # type: ignore[no-untyped-def]
    """The 64-bit integer or pointer at a byte offset of a struct."""
    return carray(_pointer(struct + offset), (1,), np.int64)[0]


@compiled.jit
def _numbers(struct, offset, start, length):  # type: ignore[no-untyped-def]
    """A view of `length` doubles from entry `start` on of an array field."""
    return carray(_pointer(_field(struct, offset) + 8 * start), (length,), np.float64)


@compiled.jit
def _integers(struct, offset, start, length):  # type: ignore[no-untyped-def]
    """A view of `length` ints from entry `start` on of an array field."""
    return carray(_pointer(_field(struct, offset) + 4 * start), (length,), np.int32)


@compiled.jit
def _to_body(xmat, P):  # type: ignore[no-untyped-def]
    """P (3, 3) = F R^T: components in the z-up world to body FRD, from the FLU body's R, row-major."""
    for j in range(3):
        P[0, j] = xmat[3 * j]
        P[1, j] = -xmat[3 * j + 1]
        P[2, j] = -xmat[3 * j + 2]


@compiled.jit
def _body_velocity(P, qvel, nu):  # type: ignore[no-untyped-def]
    """nu (6,) = T qvel: linear velocity from the world, angular from FLU."""
    for i in range(3):
        nu[i] = P[i, 0] * qvel[0] + P[i, 1] * qvel[1] + P[i, 2] * qvel[2]
    nu[3], nu[4], nu[5] = qvel[3], -qvel[4], -qvel[5]


@compiled.jit
def _exert(P, wrench, force):  # type: ignore[no-untyped-def]
    """force (6,) += T^T wrench: a body wrench (FRD, about CO) as MuJoCo's generalised force."""
    for j in range(3):
        force[j] += P[0, j] * wrench[0] + P[1, j] * wrench[1] + P[2, j] * wrench[2]
    force[3] += wrench[3]
    force[4] -= wrench[4]
    force[5] -= wrench[5]


@compiled.jit
def _add_transport(A, nu, wrench):  # type: ignore[no-untyped-def]
    """wrench (6,) += A [omega x v; 0] for an inertia A (36,)."""
    x = nu[4] * nu[2] - nu[5] * nu[1]
    y = nu[5] * nu[0] - nu[3] * nu[2]
    z = nu[3] * nu[1] - nu[4] * nu[0]
    for i in range(6):
        wrench[i] += A[6 * i] * x + A[6 * i + 1] * y + A[6 * i + 2] * z


@compiled.jit
def _add_inertia(A, P, T, half, rows, addresses, M):  # type: ignore[no-untyped-def]
    """Add T^T A T (A of 36) to six rows of MuJoCo's lower triangle; where a row is not full, make it NaN."""
    for i in range(3):
        for j in range(3):
            T[i, j] = P[i, j]
            T[i, 3 + j] = T[3 + i, j] = 0.0
            T[3 + i, 3 + j] = 0.0
        T[3 + i, 3 + i] = 1.0 if i == 0 else -1.0
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(6):
                total += A[6 * i + k] * T[k, j]
            half[i, j] = total
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(6):
                total += T[k, i] * half[k, j]
            M[addresses[i] + j] += total if rows[i] == i + 1 else np.nan


@compiled.jit
def _vehicle(model, data, parameters):  # type: ignore[no-untyped-def]
    """Add one vehicle's inertia and forces."""
    dof, body = int(parameters[AT_DOF]), int(parameters[AT_BODY])
    P, nu, wrench = np.empty((3, 3)), np.empty(6), np.zeros(6)
    _to_body(_numbers(data, _XMAT, 9 * body, 9), P)
    _body_velocity(P, _numbers(data, _QVEL, dof, 6), nu)

    coriolis = int(parameters[AT_CORIOLIS])
    if coriolis:
        coriolis_kernel(parameters[coriolis : coriolis + 36], nu, wrench)
        for i in range(6):
            wrench[i] = -wrench[i]
    held = int(parameters[AT_HELD])
    if held >= 0:
        tau = _numbers(data, _USERDATA, held, 6)
        for i in range(6):
            wrench[i] -= tau[i]
    inertia = int(parameters[AT_INERTIA])
    if inertia:
        A = parameters[inertia : inertia + 36]
        _add_transport(A, nu, wrench)
        last = _integers(model, _M_ROWADR, dof + 5, 1)[0] + 6
        _add_inertia(
            A,
            P,
            np.empty((6, 6)),
            np.empty((6, 6)),
            _integers(model, _M_ROWNNZ, dof, 6),
            _integers(model, _M_ROWADR, dof, 6),
            _numbers(data, _M, 0, last),
        )
    _exert(P, wrench, _numbers(data, _QFRC_PASSIVE, dof, 6))


@compiled.jit
def _vehicles(model, data):  # type: ignore[no-untyped-def]
    """All vehicles of a model, each from its numeric field."""
    count = _field(model, _NNUMERIC)
    adr, sizes = _integers(model, _NUMERIC_ADR, 0, count), _integers(model, _NUMERIC_SIZE, 0, count)
    fresh = False
    for i in range(count):
        if sizes[i] < HEADER:
            continue
        parameters = _numbers(model, _NUMERIC_DATA, adr[i], sizes[i])
        if parameters[AT_MAGIC] != MAGIC:
            continue
        if (
            parameters[AT_DOF] < 0.0
        ):  # never prepared: let MuJoCo stop with its warning, not fly on without water
            _numbers(data, _QFRC_PASSIVE, 0, 1)[0] = np.nan
            continue
        if not fresh and parameters[AT_INERTIA]:
            # A caller may repeat the velocity stage without the position stage: start from MuJoCo's own M.
            _mj_makeM(model, data)
            fresh = True
        _vehicle(model, data, parameters)
    if fresh:
        _mj_factorM(model, data)


@cache
def _passive() -> Any:
    """The callback, compiled on first use."""
    for name in ("mj_factorM", "mj_makeM"):
        llvm.add_symbol(name, ctypes.cast(getattr(_library(), name), ctypes.c_void_p).value)

    @compiled.cfunc(types.void(types.intp, types.intp))
    def passive(model, data):  # type: ignore[no-untyped-def]
        _vehicles(model, data)

    return passive
