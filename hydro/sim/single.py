"""One vehicle as a plain MuJoCo model with its data, for stepping, viewing, and export as MJCF.

MuJoCo writes MJCF with six digits, which is too few for a vehicle.  Therefore all numbers that affect its
motion are written again in full, from the compiled model.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

import mujoco

from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle, require_names
from hydro.sim.bridge import mjcf, native
from hydro.sim.bridge.water import PREFIX
from hydro.sim.student import Physics

Pair = tuple[mujoco.MjModel, mujoco.MjData]


def single(vehicle: Vehicle, physics: Physics, folder: Path | None = None) -> Pair:
    """Return a MuJoCo model of one vehicle in unbounded water with its data, at rest at the origin.

    Args:
        vehicle: Vehicle file.
        physics: Step and integrator.
        folder: Folder of the vehicle file, which has its hull mesh; without it the hull is an ellipsoid.

    Raises:
        DataError: The vehicle cannot be simulated.
    """
    return _ready(_scene(vehicle, physics, folder).compile())


def load(path: str | Path) -> Pair:
    """Return the MuJoCo model in an MJCF file with its data, with hydro's water forces, ready to step.

    Args:
        path: File written by `text`; scenery and sensors may have been added.

    Raises:
        DataError: MuJoCo cannot read the file, or it has no vehicle, or one of another version of hydro.
    """
    if not Path(path).is_file():
        raise DataError(f"{path}: no such file: check the path")
    try:
        model = mujoco.MjModel.from_xml_path(os.fspath(path))
    except ValueError as error:
        raise DataError(f"{path}: {' '.join(str(error).split())}") from None
    names = [model.numeric(i).name for i in range(model.nnumeric)]
    if not any(name.startswith(PREFIX) for name in names):
        raise DataError(f"{path}: no vehicle in water: make one with `hydro export VEHICLE --to mujoco`")
    return _ready(model)


def text(vehicle: Vehicle, physics: Physics) -> str:
    """Return the MuJoCo model of a vehicle, with its water forces, as the text of an MJCF file.

    Args:
        vehicle: Vehicle file.
        physics: Step and integrator.

    Raises:
        DataError: The vehicle cannot be simulated, or XML would change a name.
    """
    require_names(vehicle)
    spec = _scene(vehicle, physics, None)
    model = spec.compile()
    root = ET.fromstring(spec.to_xml())
    option = _found(root, "option")
    option.set("timestep", _numbers([model.opt.timestep]))
    option.set("gravity", _numbers(model.opt.gravity))
    for element in root.iter("body"):
        body = model.body(element.attrib["name"]).id
        inertial = _found(element, "inertial")
        inertial.set("pos", _numbers(model.body_ipos[body]))
        inertial.set("quat", _numbers(model.body_iquat[body]))
        inertial.set("mass", _numbers([model.body_mass[body]]))
        inertial.set("diaginertia", _numbers(model.body_inertia[body]))
        element.set("pos", _numbers(model.body_pos[body]))
        element.set("gravcomp", _numbers([model.body_gravcomp[body]]))
    for element in root.iter("site"):
        element.set("pos", _numbers(model.site(element.attrib["name"]).pos))
    for element in _found(root, "actuator") if model.nu else ():
        actuator = model.actuator(element.attrib["name"]).id
        element.set("gear", _numbers(model.actuator_gear[actuator]))
        element.set("ctrlrange", _numbers(model.actuator_ctrlrange[actuator]))
        element.set("gainprm", _numbers(model.actuator_gainprm[actuator]))
        if "delay" in element.attrib:
            element.set("delay", _numbers([model.actuator_delay[actuator]]))
    for element in root.iter("numeric"):
        element.set("data", _numbers(model.numeric(element.attrib["name"]).data))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _scene(vehicle: Vehicle, physics: Physics, folder: Path | None) -> mujoco.MjSpec:
    return mjcf.scene(vehicle, timestep=physics.timestep, integrator=physics.integrator, folder=folder)


def _ready(model: mujoco.MjModel) -> Pair:
    """Return the model ready to step, and its data."""
    return native.prepare(model), mujoco.MjData(model)


def _found(root: ET.Element, tag: str) -> ET.Element:
    """Return the first element with a tag in MuJoCo's XML."""
    found = root.find(tag)
    assert found is not None, tag
    return found


def _numbers(values: Iterable[float]) -> str:
    """Return numbers as text with all digits."""
    return " ".join(f"{float(value):.17g}" for value in values)
