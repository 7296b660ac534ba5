"""The targets of `hydro export`: what each takes, what it writes, and what it cannot hold.

A target is one file with a `TARGET`, named in `MODULES`; the command, its help and its tests read them here.
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
"""Files of targets in this package, in the order of the help."""


@dataclass(frozen=True)
class Lack:
    """Something of a vehicle that a target cannot hold.

    Attributes:
        what: An effect, or a property of the file.
        why: What the target has in its place, or why it has none.
        without: The vehicle as the target has it in this respect; None where no motion depends on it.
    """

    what: str
    why: str
    without: Vehicle | None = None


@dataclass(frozen=True)
class Target:
    """A format that something is exported to.

    Attributes:
        name: As `--to` takes it.
        takes: What is exported: a vehicle file, or a trained network.
        suffix: Of a file in this format, by which it is known where `--to` says nothing.
        summary: In a few words.
        write: The file, of a vehicle or a network.
        lacks: What of a vehicle it cannot hold.
        warnings: What its user must know besides, a line each.
        text: Whether a person can read the file.
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
    """All targets by name."""
    found = [import_module(f"hydro.export.{module}").TARGET for module in MODULES]
    return {target.name: target for target in found}


def choose(to: str | None, takes: str, output: str) -> Target:
    """The target that is asked for.

    Args:
        to: Its name; None: by the suffix of the output, or the only one that takes such a thing.
        takes: `vehicle` or `model`.
        output: Where it is written to.

    Raises:
        UsageError: No target has the name or the suffix, or it does not take such a thing.
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
    raise UsageError(f"--to: say which of {', '.join(fitting)} {what} is exported to")


def without_effects(vehicle: Vehicle, left_out: Callable[[Effect], bool]) -> Vehicle:
    """The vehicle without some effects."""
    kept = tuple(table for table in vehicle.effect if not left_out(CATALOGUE[table["name"]]))
    return msgspec.structs.replace(vehicle, effect=kept)


def lacking(vehicle: Vehicle, why: Callable[[Effect], str]) -> list[Lack]:
    """Effects of a vehicle that a target cannot hold, each once; `why` says nothing of those it can."""
    found = []
    for name in dict.fromkeys(str(table["name"]) for table in vehicle.effect):
        effect = CATALOGUE[name]
        if reason := why(effect):
            moves = effect.kind != "sensor"
            found.append(Lack(name, reason, vehicle.without(name) if moves else None))
    return found


def of_sensors(effect: Effect) -> str:
    """Why no simulator holds an error of the velocity log."""
    return "an error of the velocity log, not of the motion" if effect.kind == "sensor" else ""


def all_left_out(vehicle: Vehicle, lacks: Sequence[Lack]) -> Vehicle:
    """The vehicle as a target has it: without all that it cannot hold.

    Each lack changes effects or thrusters: those of every `without` are taken together.
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
