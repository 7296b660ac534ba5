"""MuJoCo model of a vehicle file, with native rigid body, restoring forces, hull and thrusters.

MuJoCo's world is z-up and its bodies here are FLU: the images of NED and FRD under diag(1, -1, -1).  The
body's origin is the vehicle file's origin CO.  Thruster chain, added mass, effects and a residual model are
unknown to MuJoCo.  They are stored in `<custom><numeric>` (`sim.bridge.water`) and computed by compiled
callbacks (`sim.bridge.callbacks`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.program import thrusters_of
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Hull, Thruster, Vehicle
from hydro.core.vehicle.frames import FRD_FLU, HALF_TURN
from hydro.core.vehicle.thrusters import (
    ASYMMETRY,
    BEYOND,
    DELAY,
    GAIN,
    INFLOW,
    LAG_STEP,
    REACTION,
    SPEED_LAG,
    TIME_CONSTANT,
)
from hydro.sim.bridge.water import PREFIX, Water, wet

Integrator = Literal["euler", "implicitfast", "implicit", "rk4"]

_INTEGRATORS = {
    "euler": mujoco.mjtIntegrator.mjINT_EULER,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "rk4": mujoco.mjtIntegrator.mjINT_RK4,
}

_LENT_MASS = 1e-6
"""Share of the vehicle's mass in the welded body that carries buoyancy.

MuJoCo's gravity compensation is a multiple of a body's weight, so that body needs some mass.
"""
_LENT_RADIUS = 1e-2
"""Radius of gyration of that body [m], so that its inertia is not zero."""

VISCOSITY = 1e-3  # viscosity of water [Pa s]
FLUID = (0.5, 0.25, 1.5, 1.0, 1.0)
"""Default coefficients of MuJoCo's fluid model: blunt, slender and angular drag, Kutta and Magnus lift."""


def scene(
    vehicle: Vehicle,
    water: Water | None = None,
    *,
    timestep: float = 0.002,
    integrator: Integrator = "implicitfast",
    folder: Path | None = None,
) -> mujoco.MjSpec:
    """Return a MuJoCo specification (`MjSpec`) of one vehicle in unbounded water.

    Args:
        vehicle: Vehicle file.
        water: Water forces that act; by default all of the file.
        timestep: Physics step [s].
        integrator: MuJoCo integrator.
        folder: Folder of the vehicle file, which has its hull mesh; without it the hull is an ellipsoid.

    Returns:
        Specification, to which pillars, cameras or more vehicles may be added before `compile()`;
        `sim.bridge.native.prepare` then makes the compiled model ready to step.

    Raises:
        DataError: No rigid body can have the vehicle's inertia.
    """
    spec = mujoco.MjSpec()
    spec.modelname = vehicle.name
    spec.compiler.fusestatic = False
    spec.option.timestep = timestep
    spec.option.integrator = _INTEGRATORS[integrator]
    spec.option.gravity = [0.0, 0.0, -vehicle.environment.gravity]
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1280, 720
    spec.worldbody.add_light(pos=[0, 0, 20], dir=[0, 0, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    add_vehicle(spec, vehicle, water, folder=folder)
    return spec


def add_vehicle(
    spec: mujoco.MjSpec,
    vehicle: Vehicle,
    water: Water | None = None,
    *,
    name: str | None = None,
    folder: Path | None = None,
) -> mujoco.MjsBody:
    """Add a floating vehicle to a scene, which is changed in place.

    The body is called `name`, and its thrusters' sites and actuators `name/T1`, …  Each actuator's control is
    the thruster's command in [-1, 1], its force the thrust [N].

    Args:
        spec: Scene, with gravity along -z.
        vehicle: Vehicle file.
        water: Water forces that act; by default all of the file.
        name: Name of the body; the vehicle's name by default.
        folder: Folder of the vehicle file, which has its hull mesh.

    Returns:
        The vehicle's body.

    Raises:
        DataError: No rigid body can have the vehicle's inertia.
    """
    name = vehicle.name if name is None else name
    body = spec.worldbody.add_body(name=name, sleep=mujoco.mjtSleepPolicy.mjSLEEP_NEVER)
    joint = body.add_freejoint(name=name)
    joint.align = mujoco.mjtAlignFree.mjALIGNFREE_FALSE
    _add_mass(body, vehicle, name)
    hull = _add_hull(spec, body, vehicle.hull, name, folder)
    water = wet(vehicle) if water is None else water
    if water.ellipsoid:
        _use_fluid_model(spec, hull, vehicle.environment.water_density)
    table = thrusters_of(water.program.flat)
    for i, (thruster, row) in enumerate(zip(vehicle.thruster, table, strict=True)):
        carried = water.activations if i == 0 else 0
        _add_thruster(spec, body, thruster, row, carried, f"{name}/{thruster.name}")
    if water.activations or (table[:, DELAY] > 0.0).any():
        _add_clock(spec, body, f"{name}/clock", carries=0 if vehicle.thruster else water.activations)
    data = water.encode(held=spec.nuserdata)
    spec.nuserdata += 6 if water.held else 0
    spec.add_numeric(name=PREFIX + name, data=data, size=len(data))
    return body


def _point_inertia(mass: float, at: Array) -> Array:
    """Return the inertia (3, 3) [kg m^2] of a point mass [kg] at a place (3,) [m] about the origin."""
    inertia: Array = mass * (at @ at * np.eye(3) - np.outer(at, at))
    return inertia


def _add_mass(body: mujoco.MjsBody, vehicle: Vehicle, name: str) -> None:
    """Set the mass and inertia of the body, and weld a buoyant child to the centre of buoyancy."""
    rigid, buoyancy = vehicle.rigid_body, vehicle.buoyancy
    mass, lent = rigid.mass, _LENT_MASS * rigid.mass
    center_of_gravity = np.array(rigid.center_of_gravity)
    center_of_buoyancy = np.array(buoyancy.center)
    lent_inertia = np.full(3, lent * _LENT_RADIUS**2)

    rest = mass - lent
    rest_center = (mass * center_of_gravity - lent * center_of_buoyancy) / rest
    rest_inertia = (
        np.array(rigid.inertia)
        - np.diag(lent_inertia)
        - _point_inertia(lent, center_of_buoyancy - center_of_gravity)
        - _point_inertia(rest, rest_center - center_of_gravity)
    )
    _check_inertia(rest_inertia, vehicle.name)
    flipped = rest_inertia * np.outer(HALF_TURN, HALF_TURN)
    body.explicitinertial = True
    body.mass = rest
    body.ipos = HALF_TURN * rest_center
    body.fullinertia = flipped[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

    float_ = body.add_body(name=f"{name}/buoyancy", pos=HALF_TURN * center_of_buoyancy)
    float_.explicitinertial = True
    float_.ipos = np.zeros(3)
    float_.mass = lent
    float_.inertia = lent_inertia
    float_.gravcomp = buoyancy.force / (lent * vehicle.environment.gravity)


def _check_inertia(inertia: Array, vehicle: str) -> None:
    """Check that no principal moment of inertia exceeds the sum of the other two, as in any rigid body.

    Raises:
        DataError: A principal moment is too large; `vehicle` is the name in the message.
    """
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] <= 0 or moments[2] > moments[0] + moments[1]:
        raise DataError(
            f"vehicle {vehicle}: rigid_body.inertia has principal moments "
            f"{np.array2string(moments, precision=4)} kg m^2, which no rigid body has: the largest may not "
            "exceed the sum of the other two; correct the file"
        )


def _add_hull(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, hull: Hull, name: str, folder: Path | None
) -> mujoco.MjsGeom:
    """Return a visible, touchable hull without mass: the mesh if the folder is known, else an ellipsoid."""
    style = {"name": f"{name}/hull", "mass": 0.0, "rgba": [0.95, 0.75, 0.1, 1.0]}
    mesh = folder / hull.mesh if folder is not None and hull.mesh else None
    if mesh is None:
        half = np.array([hull.length, hull.width, hull.height]) / 2
        return body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_ELLIPSOID, size=half, pos=HALF_TURN * hull.center, **style
        )
    if not mesh.is_file():
        raise DataError(
            f"{mesh}: the hull mesh named by the vehicle file is not there; correct hull.mesh or leave it out"
        )
    # The mesh is in FRD: half a turn about x brings it to FLU.
    spec.add_mesh(name=f"{name}/hull", file=str(mesh.resolve()))
    return body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"{name}/hull", quat=[0, 1, 0, 0], **style)


def _use_fluid_model(spec: mujoco.MjSpec, hull: mujoco.MjsGeom, density: float) -> None:
    """Apply MuJoCo's fluid model to the hull with its default coefficients in water.

    It has drag, lift and the Coriolis terms of the ellipsoid's added mass, but no M_A nu_dot.
    """
    spec.option.density, spec.option.viscosity = density, VISCOSITY
    hull.fluid_ellipsoid, hull.fluid_coefs = 1.0, FLUID


def _add_thruster(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, thruster: Thruster, row: Array, carried: int, name: str
) -> None:
    """Add a site where the thrust acts, and an actuator: control is the command, force the thrust [N].

    Its activations are `carried` numbers of the vehicle, then its delayed command if it has a delay, then its
    lag state.  A servo has an actuator without force, so that effects read its control.
    """
    if not thruster.pushes:
        site, wrench = body.add_site(name=name), np.zeros(6)
    elif thruster.wrench is not None:
        site, wrench = body.add_site(name=name), np.array(thruster.wrench)
    else:
        site = body.add_site(name=name, pos=HALF_TURN * np.array(thruster.position), size=[0.03, 0.03, 0.03])
        wrench = np.concatenate([thruster.direction, np.zeros(3)])
    wrench[3:] += row[REACTION] * wrench[:3]
    actuator = spec.add_actuator(
        name=name,
        trntype=mujoco.mjtTrn.mjTRN_SITE,
        target=site.name,
        gear=wrench * FRD_FLU,
        ctrllimited=mujoco.mjtLimited.mjLIMITED_TRUE,
        ctrlrange=[-1.0 - row[BEYOND], 1.0 + row[BEYOND]],
    )
    delayed, lags = bool(row[DELAY] > 0.0), bool(row[TIME_CONSTANT] > row[LAG_STEP])
    proportional = lags and not row[[SPEED_LAG, ASYMMETRY, INFLOW]].any()
    # MuJoCo multiplies the lag state by a gain; for a proportional thruster this replaces its callback.
    actuator.gainprm[0] = 1.0 + row[GAIN] if proportional else 0.0
    actuator.biastype = mujoco.mjtBias.mjBIAS_NONE if proportional else mujoco.mjtBias.mjBIAS_USER
    if carried or delayed or lags:
        actuator.dyntype = mujoco.mjtDyn.mjDYN_USER
        actuator.actdim = carried + delayed + 1
    if delayed:
        actuator.delay = row[DELAY]
        actuator.nsample = int(np.ceil(row[DELAY] / spec.option.timestep)) + 1


def _add_clock(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, carries: int) -> None:
    """Add a sensor that triggers the callback once per step, and an actuator for internal states, if any."""
    spec.add_sensor(
        name=name, type=mujoco.mjtSensor.mjSENS_USER, dim=1, needstage=mujoco.mjtStage.mjSTAGE_POS
    )
    if carries:
        site = body.add_site(name=name)
        spec.add_actuator(
            name=name,
            trntype=mujoco.mjtTrn.mjTRN_SITE,
            target=site.name,
            gainprm=np.zeros(10),
            dyntype=mujoco.mjtDyn.mjDYN_USER,
            actdim=carries + 1,
        )
