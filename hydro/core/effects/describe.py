"""Description of an effect in words for the command line, the documentation and a vehicle file."""

from __future__ import annotations

import json
import math
from typing import Any

from hydro.core.effects.record import Effect, Parameter

AXES = ("X Y Z", "K M N")


def describe(effect: Effect) -> dict[str, Any]:
    """Return the whole record of an effect as plain text and numbers, in a dict by name.

    Missing bounds are None.
    """
    return {
        "name": effect.name,
        "kind": effect.kind,
        "family": effect.family,
        "definition": effect.definition,
        "description": effect.description,
        "parameters": [
            {
                "name": parameter.name,
                "unit": unit(parameter),
                "size": size(parameter),
                "low": parameter.low if math.isfinite(parameter.low) else None,
                "high": parameter.high if math.isfinite(parameter.high) else None,
                "plausible": plausible(parameter),
                "plausible_source": parameter.plausible.source if parameter.plausible else None,
                "when_left_out": when_left_out(effect, parameter),
                "meaning": parameter.meaning,
            }
            for parameter in effect.parameters
        ],
        "internal_states": effect.states is not None,
        "excitation": effect.excitation,
        "lookalikes": list(effect.lookalikes),
        "source": effect.source,
        "toml": toml(effect),
    }


def unit(parameter: Parameter) -> str:
    """Return the unit of a parameter as text, such as `N s/m`.

    If the components have several units, each unit is followed by its axes: `N s/m (X Y Z), N m s/rad
    (K M N)`.
    """
    units = parameter.unit
    if len(units) == 1:
        return units[0]
    axes = AXES if len(units) == 2 else (AXES[0], "mixed", AXES[1])
    return ", ".join(f"{one} ({axis})" for one, axis in zip(units, axes, strict=True))


def size(parameter: Parameter) -> str:
    """Return the size of a parameter as text: `1`, `6 x 6`, `one per thruster`, `6 per rate`."""
    counts = [str(n) for n in parameter.shape if isinstance(n, int)]
    each = [f"per {n.removesuffix('s')}" for n in parameter.shape if isinstance(n, str)]
    return " ".join([" x ".join(counts) or ("one" if each else "1"), *each])


def bounds(parameter: Parameter) -> str:
    """Return the admissible values of a parameter as text: `any`, `>= 0`, `<= 1` or `-1 to 1`."""
    low, high = parameter.low, parameter.high
    if math.isfinite(low) and math.isfinite(high):
        return f"{low:g} to {high:g}"
    if math.isfinite(low):
        return f">= {low:g}"
    return f"<= {high:g}" if math.isfinite(high) else "any"


def plausible(parameter: Parameter) -> str:
    """Return the plausible range of a parameter in words; `not said` if the record has none."""
    return parameter.plausible.words if parameter.plausible else "not said"


def when_left_out(effect: Effect, parameter: Parameter) -> str:
    """Return text for a parameter that a vehicle file omits: `0`, `must be given`, or the alternative.

    Args:
        effect: The effect.
        parameter: Parameter of the effect.
    """
    if parameter.name in effect.one_of:
        others = [name for name in effect.one_of if name != parameter.name]
        return f"give {' or '.join(others)} instead"
    return "must be given" if parameter.required else "0"


def toml(effect: Effect, thrusters: int = 2) -> str:
    """Return the text of a neutral `[[effect]]` table: every value is 0, or 1 if 0 is not allowed.

    Args:
        effect: The effect.
        thrusters: Number of thrusters of the vehicle.
    """
    lines = ["[[effect]]", f'name = "{effect.name}"']
    lines += [f"{one.name} = {json.dumps(one.example)}  # {one.meaning}" for one in effect.words]
    counts = {"thrusters": thrusters, "rates": 1}
    if effect.structure is not None:
        whole: dict[str, Any] = {one.name: [] for one in effect.parameters}
        whole |= {one.name: one.example for one in effect.words}
        counts |= effect.structure(whole, "example")[1]
    for parameter in effect.parameters:
        said = f"{parameter.meaning} [{unit(parameter)}]"
        if parameter.shape and not isinstance(parameter.shape[0], int):
            said += f", {size(parameter)}"
        if parameter.name in effect.one_of[1:]:
            lines.append(f"# or {parameter.name}: {said}, {size(parameter)} numbers")
        else:
            value = _value(parameter, counts)
            lines.append(f"{parameter.name} = {json.dumps(value)}  # {said}")
    return "\n".join(lines) + "\n"


def _value(parameter: Parameter, counts: dict[str, int]) -> Any:
    """Return the neutral value of a parameter, nested as in a vehicle file."""
    value: Any = 1.0 if parameter.low > 0.0 else 0.0
    for n in reversed(parameter.shape):
        value = [value] * (counts[n] if isinstance(n, str) else n)
    return value
