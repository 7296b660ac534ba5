"""Target `python`: one file without dependencies, with a class as in Fossen's Python Vehicle Simulator.

It contains the source of `export.craft`, the kernels of the vehicle's effects, and its numbers.  Lists and
`math` suffice: a kernel is scalar, and reading numpy arrays entry by entry would be slower.
"""

from __future__ import annotations

import keyword
import re
from importlib.metadata import version

from hydro.core.vehicle.description import Vehicle
from hydro.export.craft import Craft
from hydro.export.numbers import model_of
from hydro.export.source import Bundle, in_docstring
from hydro.export.targets import Lack, Target, lacking_effects, sensor_reason

HEAD = '''"""{name}: equations of motion, written by hydro {version} from its vehicle file.

After Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control (2011). Needs nothing but Python.

    vehicle = {cls}()
    eta, nu, u_actual = [0.0] * 6, [0.0] * 6, [0.0] * {thrusters}
    nu, u_actual = vehicle.dynamics(eta, nu, u_actual, u_control, sampleTime)
    eta, nu, u_actual = vehicle.step(eta, nu, u_actual, u_control, sampleTime)  # with the pose
"""

'''


def to_python(vehicle: Vehicle) -> bytes:
    """Return the bytes of a Python file with a class that simulates a vehicle.

    `class_name` gives the name of the class; `Vehicle` is prepended if that name is already used in the file.

    Raises:
        DataError: An effect or a thruster of the vehicle is invalid.
    """
    bundle = Bundle()
    base = bundle.add(Craft)
    model = model_of(vehicle, lambda function, effect: _Name(bundle.add(function, effect)))
    name, called = class_name(vehicle.name), in_docstring(vehicle.name)
    if name in bundle.definitions or name in bundle.constants:
        name = f"Vehicle{name}"
    head = HEAD.format(
        name=called, version=version("deep-hydro-sim"), cls=name, thrusters=len(vehicle.thruster)
    )
    own = (
        f"class {name}({base}):\n"
        f'    """{called}."""\n\n'
        f"    name = {vehicle.name!r}\n"
        f"    controls = {tuple(thruster.name for thruster in vehicle.thruster)!r}\n"
        f"    model = Model(\n"
        f"        flat={model.flat!r},\n"
        f"        thrusters={model.thrusters!r},\n"
        f"        curves={model.curves!r},\n"
        f"        effects={model.effects!r},\n"
        f"    )\n"
    )
    return f"{head}{bundle.text()}\n\n\n{own}".encode()


class _Name(str):
    """Name that is written into a source without quotes."""

    def __repr__(self) -> str:
        return str(self)


def class_name(vehicle: str) -> str:
    """Return the class name for a vehicle's name: `bluerov2-heavy` gives `Bluerov2Heavy`."""
    words = re.findall(r"[A-Za-z0-9]+", vehicle)
    name = "".join(word[:1].upper() + word[1:] for word in words)
    return name if name[:1].isalpha() and not keyword.iskeyword(name) else f"Vehicle{name}"


def lacks(vehicle: Vehicle) -> list[Lack]:
    """Return the properties of a vehicle that the class cannot represent: the errors of its DVL."""
    return lacking_effects(vehicle, sensor_reason)


TARGET = Target(
    name="python",
    takes="vehicle",
    suffix=".py",
    summary="one Python file without dependencies, a class as in Fossen's Python Vehicle Simulator",
    write=to_python,
    lacks=lacks,
)
