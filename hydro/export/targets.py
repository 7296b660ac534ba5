"""Targets of `hydro export` (programs and file formats): input, output and missing properties of each.

A target is one file with a `TARGET`, listed in `MODULES`; the command, its help and its tests read them here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from hydro.core.effects.catalogue import CATALOGUE
from hydro.core.effects.record import Effect
from hydro.core.errors import UsageError

if TYPE_CHECKING:
    from hydro.core.vehicle.description import Vehicle

MODULES = ("python_class", "casadi_function", "mujoco_model", "gazebo", "onnx_network")
"""Modules of the targets in this package, in the order of the help."""


@dataclass(frozen=True)
class Lack:
    """Property of a vehicle that a target cannot represent.

    Attributes:
        what: An effect, or a property of the file.
        why: The target's replacement, or the reason why it has none.
        without: The vehicle without this property; None if no motion depends on it.
    """

    what: str
    why: str
    without: Vehicle | None = None


@dataclass(frozen=True)
class Target:
    """Program or file format to which `hydro export` writes.

    Attributes:
        name: Value of `--to`.
        takes: Input: a vehicle file, or a trained network.
        suffix: Suffix of its files, which selects the target if `--to` is missing.
        summary: Short description.
        write: Function from a vehicle or network to the content of the file.
        lacks: Function that returns the properties of a vehicle that the target cannot represent.
        warnings: Function that returns further warnings, one line each.
        text: Whether the file is readable text.
    """

    name: str
    takes: Literal["vehicle", "model"]
    suffix: str
    summary: str
    write: Callable[[Any], bytes]
    lacks: Callable[[Vehicle], list[Lack]] = lambda vehicle: []
    warnings: Callable[[Vehicle], list[str]] = lambda vehicle: []
    text: bool = True


def targets() -> dict[str, Target]:
    """Return all targets of `hydro export` by the name that `--to` takes."""
    found = [import_module(f"hydro.export.{module}").TARGET for module in MODULES]
    return {target.name: target for target in found}


def choose(to: str | None, takes: str, output: str) -> Target:
    """Return the target that the user asks for, by name or by the suffix of the output file.

    Args:
        to: Name of the target; None selects by the suffix of the output, or the only target for this input.
        takes: `vehicle` or `model`.
        output: Path of the output.

    Raises:
        UsageError: No target has the name or the suffix, or it does not take this input.
    """
    known = targets()
    fitting = {name: target for name, target in known.items() if target.takes == takes}
    what = "a vehicle file" if takes == "vehicle" else "a network or a policy"
    if to is not None and to not in known:
        raise UsageError(f"--to {to}: there is no such target; there are {', '.join(known)}")
    if to is not None and to not in fitting:
        other = "a network or a policy (.parquet)" if takes == "vehicle" else "a vehicle file (.toml)"
        raise UsageError(f"--to {to}: takes {other}; {what} goes to {', '.join(fitting)}")
    if to is not None:
        return known[to]
    chosen = [target for target in fitting.values() if output.endswith(target.suffix)]
    if len(chosen) == 1 or len(fitting) == 1:
        return (chosen or list(fitting.values()))[0]
    raise UsageError(f"--to: choose one of {', '.join(fitting)} for {what}")


def without_effects(vehicle: Vehicle, left_out: Callable[[Effect], bool]) -> Vehicle:
    """Return a copy of the vehicle without the effects for which `left_out` is true."""
    kept = tuple(table for table in vehicle.effect if not left_out(CATALOGUE[table["name"]]))
    return msgspec.structs.replace(vehicle, effect=kept)


def lacking_effects(vehicle: Vehicle, why: Callable[[Effect], str]) -> list[Lack]:
    """Return the effects of a vehicle that a target cannot represent, each name once.

    Args:
        vehicle: The vehicle.
        why: Function that returns why the target cannot represent an effect; an empty text if it can.
    """
    found = []
    for name in dict.fromkeys(str(table["name"]) for table in vehicle.effect):
        effect = CATALOGUE[name]
        if reason := why(effect):
            moves = effect.kind != "sensor"
            found.append(Lack(name, reason, vehicle.without(name) if moves else None))
    return found


def sensor_reason(effect: Effect) -> str:
    """Return why no target represents an error of the DVL, in words; an empty text for any other effect."""
    return "an error of the DVL, not of the motion" if effect.kind == "sensor" else ""


def all_left_out(vehicle: Vehicle, lacks: Sequence[Lack]) -> Vehicle:
    """Return a copy of the vehicle without all properties in `lacks`, as a target represents the vehicle.

    Each entry of `lacks` changes effects or thrusters; the changes are combined.
    """
    effects, thrusters = list(vehicle.effect), list(vehicle.thruster)
    for lack in lacks:
        if lack.without is None:
            continue
        effects = [table for table in effects if table in lack.without.effect]
        for i, (before, after) in enumerate(zip(vehicle.thruster, lack.without.thruster, strict=True)):
            changed = {
                key: value
                for key, value in msgspec.structs.asdict(after).items()
                if value != getattr(before, key)
            }
            thrusters[i] = msgspec.structs.replace(thrusters[i], **changed)
    return msgspec.structs.replace(vehicle, effect=tuple(effects), thruster=tuple(thrusters))
