"""Vehicles in MuJoCo, and on a GPU."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, overload

if TYPE_CHECKING:
    from pathlib import Path

    from hydro.core.vehicle.description import Vehicle
    from hydro.sim.gpu.plant import GpuPlant
    from hydro.sim.single import Pair

Integrator = Literal["euler", "implicitfast", "implicit", "rk4"]


@overload
def student(
    vehicle: Vehicle,
    *,
    timestep: float | None = None,
    integrator: Integrator = "implicitfast",
    folder: str | Path | None = None,
    device: Literal["cpu"] = "cpu",
) -> Pair: ...


@overload
def student(
    vehicle: Vehicle,
    *,
    timestep: float | None = None,
    device: Literal["cuda"],
    count: int = 1,
    period: float = 0.04,
) -> GpuPlant: ...


def student(
    vehicle: Vehicle,
    *,
    timestep: float | None = None,
    integrator: Integrator | None = None,
    folder: str | Path | None = None,
    device: Literal["cpu", "cuda"] = "cpu",
    count: int | None = None,
    period: float | None = None,
) -> Pair | GpuPlant:
    """Build a vehicle in MuJoCo with every effect of its file, for `mujoco.mj_step` and the viewer.

    A compiled callback, which is installed in the process, adds the water forces. Added mass is part of the
    mass matrix. MuJoCo's world has z up, and its bodies have forward, left and up axes. Controls are the
    commands of the thrusters in [-1, 1]. For a thruster with a thrust table they are effective commands, see
    `hydro.core.recording.supply.effective_commands`.

    With `device="cuda"` (extra `gpu`) many copies of the vehicle are simulated on an NVIDIA GPU, without
    MuJoCo and without contacts, by the equations of `hydro.simulate`. See
    [Many vehicles on a GPU](gpu.md).

    Args:
        vehicle: vehicle, from `hydro.vehicle`.
        timestep: physics step [s]; by default 0.002 in MuJoCo, and at most 0.01 on a GPU, where the method
            is of fourth order.
        integrator: integrator of MuJoCo; by default `implicitfast`. The motion with `rk4` differs from that
            of `hydro.simulate` by 1e-7 after a minute.
        folder: folder of the vehicle file, which may contain a hull mesh; without it an ellipsoid is shown.
        device: `cpu`, or `cuda` for a GPU.
        count: only on a GPU: number of vehicles, by default 1.
        period: only on a GPU: control step [s], by default 0.04.

    Returns:
        MuJoCo's model and data, with the vehicle at rest at the origin. On a GPU a `hydro.GpuPlant`:
        `reset(mask, pose, velocity)` starts vehicles, and `step(commands)` simulates one control step.

    Raises:
        hydro.core.errors.DataError: the vehicle cannot be simulated.
        hydro.core.errors.UsageError: there is no such device, no GPU or no numba-cuda, or an argument
            belongs to the other device.
    """
    from pathlib import Path

    from hydro.core.errors import UsageError

    if device not in ("cpu", "cuda"):
        raise UsageError(f"device: expected cpu or cuda, got {device}")
    on_gpu = device == "cuda"
    of_mujoco = _given(integrator=integrator, folder=folder)
    of_gpu = _given(count=count, period=period)
    for name in of_mujoco if on_gpu else of_gpu:
        raise UsageError(f"{name} means nothing with device='{device}'; leave it out")
    if on_gpu:
        from hydro.sim.gpu.plant import GpuPlant

        return GpuPlant(vehicle, **of_gpu, **_given(timestep=timestep))
    from hydro.sim.single import single
    from hydro.sim.student import Physics

    physics = Physics(**_given(timestep=timestep, integrator=integrator))
    return single(vehicle, physics, None if folder is None else Path(folder))


def _given(**values: Any) -> dict[str, Any]:
    """Return the arguments that are not None, by name, so that all others keep their defaults."""
    return {name: value for name, value in values.items() if value is not None}


def load_student(path: str | Path) -> Pair:
    """Build a vehicle in MuJoCo from an MJCF file that `hydro export --to mujoco` wrote.

    Args:
        path: the file; you may have added pillars, cameras and sensors to it.

    Returns:
        MuJoCo's model and data, as `hydro.student` returns them.

    Raises:
        hydro.core.errors.DataError: MuJoCo cannot read the file, or it has no vehicle that this version of
            hydro wrote.
    """
    from hydro.sim.single import load

    return load(path)
