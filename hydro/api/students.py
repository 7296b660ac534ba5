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
    """A vehicle in MuJoCo, with every effect of its file: ready for `mujoco.mj_step` and the viewer.

    With `device="cuda"` (extra `gpu`) many of it on an NVIDIA GPU, without MuJoCo, by the equations of
    `hydro.simulate`; there are no contacts. See [Many vehicles on a GPU](gpu.md).

    The compiled callback is installed in the process; added mass stands in the mass matrix. MuJoCo's world is
    z-up and its bodies forward, left, up. Controls are the thrusters' commands in [-1, 1]; where a thrust
    curve is a table, those that give its thrust by a plain curve
    (`hydro.core.recording.supply.effective_commands`).

    Args:
        vehicle: the vehicle.
        timestep: physics step [s]; by default 0.002 in MuJoCo, and 0.01 at most on a GPU, of order 4.
        integrator: MuJoCo integrator, `implicitfast` by default; `rk4` moves as `hydro.simulate` does, to
            1e-7 over a minute.
        folder: folder of the vehicle file, where a hull mesh is looked for; without it an ellipsoid is shown.
        device: `cpu`, or `cuda` for a GPU.
        count: number of vehicles on a GPU, 1 by default.
        period: control step on a GPU [s], 0.04 by default.

    Returns:
        MuJoCo's model, and its data with the vehicle at rest at the origin. On a GPU a
        `hydro.sim.gpu.plant.GpuPlant`: `reset(mask, pose, velocity)` begins, `step(commands)` continues.

    Raises:
        hydro.core.errors.DataError: the vehicle cannot be simulated.
        hydro.core.errors.UsageError: there is no such device, no GPU or no numba-cuda, or an argument is of
            the other device.
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
    """What was given: the rest is left to the defaults of what takes it."""
    return {name: value for name, value in values.items() if value is not None}


def load_student(path: str | Path) -> Pair:
    """A vehicle in MuJoCo from an MJCF file of `hydro export --to mujoco`, as `student` gives it.

    Args:
        path: the file; pillars, cameras and sensors may have been added to it.

    Raises:
        hydro.core.errors.DataError: MuJoCo cannot read it, or it has no vehicle of this version of hydro.
    """
    from hydro.sim.single import load

    return load(path)
