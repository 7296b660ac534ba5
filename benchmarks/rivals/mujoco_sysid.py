"""MuJoCo's system identification (`mujoco.sysid`): a body with a fluid model, fitted to short rollouts.

The model is a floating ellipsoid of the hull's size with MuJoCo's fluid model.  The parameters are those of
MJCF: mass and moments of inertia (including added mass, which MuJoCo lacks), linear damping along the body's
axes, and the ellipsoid's five coefficients.  Wind instead of a current, buoyancy and its centre, and a gain
per thruster are added.  They are fitted from the file's values by `sysid.optimize`; thrusts come from the
file's thrusters.  The named group is the one whose parameters moved most in standard errors; none if none
moved by four.

    python -m benchmarks.rivals.mujoco_sysid --studies 30 -o rivals.parquet
"""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass

import mujoco
import mujoco.rollout
import numpy as np
import polars as pl
from mujoco import sysid

from benchmarks.hidden_effects.build import build
from benchmarks.hidden_effects.plant import Array
from benchmarks.rivals.contest import Answer, Held, main, weighed
from benchmarks.rivals.output_error import MOVED, SECONDS, SHOTS
from hydro.core.distillation.labels import labels
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.recording.arrays import Recording, recording, smoothed
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import FRD_FLU, HALF_TURN, quaternion_from_euler
from hydro.core.vehicle.thrusters import configuration_matrix
from hydro.sim.bridge.mjcf import FLUID, VISCOSITY

ITERATIONS = 12
FLOAT = 1e-3
"""Mass of the body that carries buoyancy [kg]: gravity compensation is a multiple of a body's weight."""
VELOCITY = ("vehicle_qvel", sysid.SignalType.MjStateQVel)
"""Compared signal.  MuJoCo's sensors refer to the start of a step, its states to the end."""


@dataclass(frozen=True)
class Group:
    """Parameters of one effect, as changes of the nominal values.

    Attributes:
        name: Name of the effect.
        scales: Typical size of each parameter [SI].
        reach: Greatest change, in scales.
    """

    name: str
    scales: Array
    reach: float = 3.0  # scales either way


def groups(vehicle: Vehicle) -> list[Group]:
    """Return the fitted groups."""
    mass, moment = vehicle.rigid_body.mass, float(np.trace(np.array(vehicle.rigid_body.inertia)) / 3)
    return [
        Group("added_mass", np.array([0.3 * mass, *np.full(3, 0.3 * moment)])),
        Group("linear_damping", np.repeat([0.3 * mass, 0.3 * moment], 3), 10.0),
        Group("quadratic_damping", np.ones(5), 10.0),
        Group("ocean_current", np.array([0.3, 0.3, 0.05])),
        Group("net_buoyancy", np.array([0.02 * 9.81 * mass])),
        Group("buoyancy_offset", np.full(3, 0.01)),
        Group("thruster_gain", np.full(len(vehicle.thruster), 0.2)),
    ]


def changes(parameters: sysid.ParameterDict, those: list[Group]) -> dict[str, Array]:
    """Return the changes of the parameters by group [SI].

    Args:
        parameters: Parameters of `mujoco.sysid`.
        those: The groups.
    """
    return {group.name: parameters[group.name].value * group.scales for group in those}


def scene(vehicle: Vehicle, dt: float, d: dict[str, Array]) -> mujoco.MjSpec:
    """Return the vehicle with changes `d` in plain MJCF; z-up and FLU, with time step `dt`."""
    plant, environment, hull = build(vehicle), vehicle.environment, vehicle.hull
    spec = mujoco.MjSpec()
    spec.compiler.balanceinertia = True  # added inertia need not be that of a rigid body
    spec.option.timestep, spec.option.integrator = dt, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = [0.0, 0.0, -environment.gravity]
    spec.option.density, spec.option.viscosity = environment.water_density, VISCOSITY
    spec.option.wind = (plant.current + d["ocean_current"]) * HALF_TURN
    body = spec.worldbody.add_body(name="vehicle")
    body.add_freejoint(name="vehicle")
    mass, inertia = plant.rigid[0, 0] + plant.added.diagonal()[:3].mean(), plant.rigid + plant.added
    body.mass = float(max(mass + d["added_mass"][0], 0.1 * mass)) - FLOAT
    body.ipos = np.array(vehicle.rigid_body.center_of_gravity, float) * HALF_TURN
    body.inertia = np.maximum(inertia.diagonal()[3:] + d["added_mass"][1:], 0.1 * inertia.diagonal()[3:])
    # Weight is unchanged: added inertia adds no weight.
    body.gravcomp = 1.0 - vehicle.rigid_body.mass / body.mass
    half = 0.5 * np.array([hull.length, hull.width, hull.height])
    geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_ELLIPSOID, size=half, mass=0.0, contype=0, conaffinity=0)
    geom.pos = np.array(hull.center, float) * HALF_TURN
    geom.fluid_ellipsoid = 1
    geom.fluid_coefs = np.maximum(np.array(FLUID) + d["quadratic_damping"], 0.0)
    body.add_site(name="CO")
    float_ = body.add_body(name="float")
    float_.mass, float_.inertia = FLOAT, np.full(3, 1e-6)
    float_.ipos = (np.array(vehicle.buoyancy.center, float) + d["buoyancy_offset"]) * HALF_TURN
    lift = vehicle.buoyancy.force + plant.lifted[0] + d["net_buoyancy"][0]
    float_.gravcomp = 1.0 + lift / (FLOAT * environment.gravity)
    _actuators(spec, vehicle, plant.linear.diagonal() + d["linear_damping"], d["thruster_gain"])
    return spec


def _actuators(spec: mujoco.MjSpec, vehicle: Vehicle, damping: Array, gains: Array) -> None:
    """Add thrusters driven by their thrusts [N], and six dampers along the body's axes."""
    where = {"trntype": mujoco.mjtTrn.mjTRN_SITE, "target": "CO"}
    for i, wrench in enumerate(configuration_matrix(vehicle).T):
        spec.add_actuator(
            name=f"T{i + 1}", gear=wrench * FRD_FLU, gainprm=[1.0 + gains[i], *np.zeros(9)], **where
        )
    for i, gear in enumerate(np.eye(6)):
        spec.add_actuator(
            name=f"D{i + 1}",
            gear=gear,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            biasprm=[0.0, 0.0, -max(damping[i], 0.0), *np.zeros(7)],
            **where,
        )


@dataclass(frozen=True)
class Shots:
    """Stretches of a recording in MuJoCo's conventions: S of them with L rows each.

    Attributes:
        states: Initial states for `mujoco.rollout`, (S, states).
        controls: Thrusts, and zeros for the dampers, (S, L, n + 6).
        velocities: Measured velocities, linear z-up and angular FLU as in `qvel`, (S, L, 6).
        dt: Row interval [s].
    """

    states: Array
    controls: Array
    velocities: Array
    dt: float

    @classmethod
    def of(
        cls, record: Recording, eta: Array, nu: Array, thrusts: Array, starts: Array, length: int
    ) -> Shots:
        """Return stretches of `length` rows from `starts` of a recording with smoothed motion."""
        rows = starts[:, None] + np.arange(length)
        pose = np.hstack([eta[:, :3] * HALF_TURN, _flipped(quaternion_from_euler(*eta[:, 3:].T))])
        turned = nu * FRD_FLU
        world = _rotated(
            pose[:, 3:], turned[:, :3]
        )  # MuJoCo's linear velocity of a free joint is in the world
        states = np.hstack([np.zeros((len(starts), 1)), pose[starts], world[starts], turned[starts, 3:]])
        force = thrusts[np.minimum(rows + 1, len(thrusts) - 1)]  # thrust reached at the end of the step
        controls = np.concatenate([0.5 * (thrusts[rows] + force), np.zeros((*rows.shape, 6))], axis=-1)
        measured = record.nu * FRD_FLU
        measured[:, :3] = _rotated(pose[:, 3:], measured[:, :3])
        return cls(states, controls, measured[rows], record.dt)

    def sequences(self, spec: mujoco.MjSpec) -> sysid.ModelSequences:
        """Return the shots in the form of `sysid.residual`."""
        model, t = spec.compile(), np.arange(self.controls.shape[1]) * self.dt
        velocities = {VELOCITY[0]: (VELOCITY[1], np.arange(6))}
        controls = sysid.TimeSeries.compute_all_control_mapping(model)
        return sysid.ModelSequences(
            "vehicle",
            spec,
            [f"shot {i}" for i in range(len(self.states))],
            list(self.states),
            [sysid.TimeSeries(t, each, controls) for each in self.controls],
            [sysid.TimeSeries(t, each, velocities) for each in self.velocities],
            allow_missing_sensors=True,  # there are none
        )

    def predicted(self, model: mujoco.MjModel) -> Array:
        """Return velocities (S, L, 6), FRD; NaN after a failure of MuJoCo."""
        after, _ = mujoco.rollout.rollout(model, mujoco.MjData(model), self.states, self.controls[:, :-1])
        states = np.concatenate([self.states[:, None], np.asarray(after)], axis=1)
        quaternions, qvel = states[..., 4:8].reshape(-1, 4), states[..., 8:14].reshape(-1, 6)
        back = _rotated(quaternions * [1.0, -1.0, -1.0, -1.0], qvel[:, :3])
        out: Array = np.hstack([back, qvel[:, 3:]]).reshape(*states.shape[:2], 6) * FRD_FLU
        return out


def _flipped(quaternions: Array) -> Array:
    """Convert attitudes from FRD-NED to FLU-z-up: both frames rotate by half a turn about x."""
    out: Array = quaternions * np.concatenate([[1.0], HALF_TURN])
    return out


def _rotated(quaternions: Array, vectors: Array) -> Array:
    """Rotate vectors (N, 3) by quaternions (N, 4)."""
    w, q = quaternions[:, :1], quaternions[:, 1:]
    across = 2.0 * np.cross(q, vectors)
    out: Array = vectors + w * across + np.cross(q, across)
    return out


def thrusts(vehicle: Vehicle, raw: pl.DataFrame) -> Array:
    """Return the thrusts of the file's thrusters (N, n) [N]."""
    found = labels(vehicle, raw)
    out: Array = found.select([f"f_{i + 1}" for i in range(len(vehicle.thruster))]).to_numpy().astype(float)
    return out


def answer(given: Vehicle, measured: pl.DataFrame) -> Answer:
    """Fit all groups of parameters to the log, and name the group that moved most."""
    record, those = recording(given, measured), groups(given)
    eta, nu = smoothed(record)
    length = round(SECONDS / record.dt)
    room = np.concatenate([np.arange(a, b - length, length) for a, b in record.segments])
    at = room[np.unique(np.linspace(0, room.size - 1, SHOTS).astype(int))]
    shots = Shots.of(record, eta, nu, thrusts(given, measured), at, length)
    parameters = sysid.ParameterDict()
    for group in those:
        zero = np.zeros(group.scales.size)
        parameters.add(sysid.Parameter(group.name, zero, zero - group.reach, zero + group.reach))

    def build_model(parameters: sysid.ParameterDict, _: mujoco.MjSpec) -> mujoco.MjModel:
        return scene(given, record.dt, changes(parameters, those)).compile()

    residual = sysid.build_residual_fn(
        models_sequences=[shots.sequences(scene(given, record.dt, changes(parameters, those)))],
        build_model=build_model,
        n_threads=1,
        resample_true=False,
        enabled_observations=[VELOCITY],
    )
    with contextlib.redirect_stdout(
        io.StringIO()
    ):  # `verbose` does not reach the solver, which prints each step
        found, result = sysid.optimize(parameters, residual, verbose=False, max_iters=ITERATIONS)
    left, _, _ = residual(found.as_vector(), found)
    _, wide = sysid.calculate_intervals(left, np.asarray(result.jac), alpha=0.3173)  # one standard error
    x = np.concatenate([found[group.name].value for group in those])
    moved = np.nan_to_num(x / np.maximum(wide, 1e-9), posinf=0.0)
    parts = np.split(moved, np.cumsum([group.scales.size for group in those])[:-1])
    sizes = [float(np.sqrt(np.mean(part**2))) for part in parts]
    best = int(np.argmax(sizes))
    model = build_model(found, mujoco.MjSpec())
    return Answer(
        those[best].name if sizes[best] >= MOVED else "",
        lambda errors, raw: error(model, given, errors, raw),
        lambda held: predicted(model, given, held),
    )


def error(model: mujoco.MjModel, given: Vehicle, errors: Ahead, raw: pl.DataFrame) -> float:
    """Return the prediction error 5 s ahead on the held-out session."""
    held = Held.of(errors, raw)
    return weighed(errors, held.starts, predicted(model, given, held))


def predicted(model: mujoco.MjModel, given: Vehicle, held: Held) -> Array:
    """Return the velocities of all predictions, (S, L, 6)."""
    force = thrusts(given, held.raw)
    shots = Shots.of(held.record, held.eta, held.nu, force, held.starts, held.length)
    return shots.predicted(model)


if __name__ == "__main__":
    main("mujoco.sysid", answer, __doc__ or "")
