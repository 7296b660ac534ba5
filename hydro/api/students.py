"""Vehicles in MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from pathlib import Path

    from hydro.core.vehicle.description import Vehicle
    from hydro.sim.single import Pair


def student(
    vehicle: Vehicle,
    *,
    timestep: float = 0.002,
    integrator: Literal["euler", "implicitfast", "implicit", "rk4"] = "implicitfast",
    folder: str | Path | None = None,
) -> Pair:
    """A vehicle in MuJoCo, with every effect of its file: ready for `mujoco.mj_step` and the viewer.

    The compiled callback is installed in the process; added mass stands in the mass matrix. MuJoCo's world is
    z-up and its bodies forward, left, up. Controls are the thrusters' commands in [-1, 1]; where a thrust
    curve is a table, those that give its thrust by a plain curve
    (`hydro.core.recording.supply.effective_commands`).

    Args:
        vehicle: the vehicle.
        timestep: physics step [s].
        integrator: MuJoCo integrator; `rk4` moves as `hydro.simulate` does, to 1e-7 over a minute.
        folder: folder of the vehicle file, where a hull mesh is looked for; without it an ellipsoid is shown.

    Returns:
        MuJoCo's model, and its data with the vehicle at rest at the origin.

    Raises:
        hydro.core.errors.DataError: the vehicle cannot be simulated.
    """
    from pathlib import Path

    from hydro.sim.single import single
    from hydro.sim.student import Physics

    physics = Physics(timestep=timestep, integrator=integrator)
    return single(vehicle, physics, None if folder is None else Path(folder))


def load_student(path: str | Path) -> Pair:
    """A vehicle in MuJoCo from an MJCF file of `hydro export --to mujoco`, as `student` gives it.

    Args:
        path: the file; pillars, cameras and sensors may have been added to it.

    Raises:
        hydro.core.errors.DataError: MuJoCo cannot read it, or it has no vehicle of this version of hydro.
    """
    from hydro.sim.single import load

    return load(path)
