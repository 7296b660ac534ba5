"""Target `mujoco`: a vehicle as MJCF, which `hydro.load_student` makes ready to step."""

from __future__ import annotations

from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import table_of
from hydro.export.targets import Lack, Target, lacking_effects, sensor_reason


def to_mjcf(vehicle: Vehicle) -> bytes:
    """Return the bytes of an MJCF file with a vehicle, with Runge-Kutta integration at 2 ms.

    Raises:
        DataError: The vehicle cannot be simulated.
    """
    from hydro.sim.single import text
    from hydro.sim.student import Physics

    return text(vehicle, Physics(integrator="rk4")).encode()


def lacks(vehicle: Vehicle) -> list[Lack]:
    """Return the properties of a vehicle that the MJCF file cannot represent: the errors of its DVL."""
    return lacking_effects(vehicle, sensor_reason)


def warnings(vehicle: Vehicle) -> list[str]:
    """Return a warning if the model's controls are effective commands and not those of the vehicle file.

    Returns:
        A list of one sentence; empty if no thrust curve is a table.
    """
    curved = [thruster.name for thruster in vehicle.thruster if table_of(thruster) is not None]
    if not curved:
        return []
    return [
        f"{', '.join(curved)}: the thrust curve is a table, and the controls are effective commands, which "
        "hydro.core.recording.supply.effective_commands(vehicle, commands) makes"
    ]


TARGET = Target(
    name="mujoco",
    takes="vehicle",
    suffix=".xml",
    summary="MJCF with added mass in the mass matrix; hydro.load_student makes it ready to step",
    write=to_mjcf,
    lacks=lacks,
    warnings=warnings,
)
