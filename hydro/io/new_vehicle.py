"""Text of a vehicle file from estimates, with a comment on the origin of each number."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hydro.core.geometry.estimate import Estimate
from hydro.core.vehicle.description import Thruster

DIGITS = 4
"""Number of significant digits of estimates; given values keep all digits."""
WIDTH = 110
"""Maximum length of a line."""


def text(found: Estimate) -> str:
    """Return the text of a vehicle file for an estimated vehicle; comments tell each number's origin.

    Args:
        found: Estimated vehicle, with the origin of its numbers.

    Returns:
        TOML, for `io.vehicle.parse`.
    """
    vehicle, origins = found.vehicle, found.origins
    body, hull = vehicle.rigid_body, vehicle.hull
    lines = [
        *_comment(
            f"Estimated by `hydro vehicle new` from mass, hull and thrusters: like a {found.form.shape}. "
            "Numbers under [[effect]] are initial values with standard errors: `hydro fit` and "
            "`hydro diagnose` weigh them against a recording."
        ),
        'format = "hydro-vehicle/1"',
        f"name = {json.dumps(vehicle.name, ensure_ascii=False)}",
        *["", "[environment]"],
        f"water_density = {_given(vehicle.environment.water_density)}          # kg/m^3",
        f"gravity = {_given(vehicle.environment.gravity)}                # m/s^2",
        *["", "[rigid_body]", f"mass = {_given(body.mass)}                     # kg, dry"],
        *_comment(f"[m] {origins['gravity']}"),
        f"center_of_gravity = {_row(body.center_of_gravity)}",
        *_comment(f"[kg m^2] about the centre of gravity; {origins['inertia']}"),
        f"inertia = {_matrix(body.inertia) if _full(body.inertia) else _rows(body.inertia)}",
        *["", "[buoyancy]"],
        f"force = {_value(vehicle.buoyancy.force, 7)}                # N, {_trim(found)}",
        *_comment(f"[m] {origins['buoyancy']}"),
        f"center = {_row(vehicle.buoyancy.center)}",
        *["", "[hull]                          # m"],
        *(f"{name} = {_value(getattr(hull, name), 7)}" for name in ("length", "width", "height")),
    ]
    if any(hull.center):
        lines.append(f"center = {_row(hull.center)}")
    if hull.mesh is not None:
        lines.append(f"mesh = {json.dumps(hull.mesh, ensure_ascii=False)}")
    if vehicle.battery is not None:
        lines += [
            "",
            "[battery]",
            f"voltage = {_given(vehicle.battery.voltage)}                 # V, nominal",
        ]
    lines.append("")
    if vehicle.thruster:
        lines += [
            *_comment(
                "Curve (linear) and time constant (0.1 s) are guesses where none was given. The order is "
                "that of a log's commands."
            ),
        ]
    for thruster in vehicle.thruster:
        lines += [*_thruster(thruster), ""]
    for table in vehicle.effect:
        lines += [*_effect(table, origins[table["name"]]), ""]
    return "\n".join(lines[:-1]) + "\n"


def _trim(found: Estimate) -> str:
    """Return the difference of buoyancy and weight [N] in words."""
    vehicle = found.vehicle
    excess = vehicle.buoyancy.force - vehicle.rigid_body.mass * vehicle.environment.gravity
    if abs(excess) < 1e-9 * vehicle.buoyancy.force:
        return "as the weight: neutral"
    return f"{abs(excess):.3g} N {'more' if excess > 0.0 else 'less'} than the weight"


def _thruster(thruster: Thruster) -> Iterable[str]:
    """Return the lines of a thruster with a named curve."""
    limits = [
        f"{key} = {_given(value)}"
        for key, value in (
            ("max_thrust", thruster.max_thrust),
            ("max_reverse_thrust", thruster.max_reverse_thrust),
        )
        if value is not None
    ]
    return (
        "[[thruster]]",
        f"name = {json.dumps(thruster.name, ensure_ascii=False)}",
        f"position = {_row(thruster.position or (), 6)}",
        f"direction = {_row(thruster.direction or (), 9)}",
        *limits,
        f'curve = "{thruster.curve}"',
        f'lag = "{thruster.lag}"',
        f"time_constant = {_given(thruster.time_constant)}",
    )


def _effect(table: Mapping[str, Any], origin: str) -> Iterable[str]:
    """Yield the lines of an effect with its standard errors."""
    yield from _comment(origin)
    yield "[[effect]]"
    yield f'name = "{table["name"]}"'
    entries = {key: value for key, value in table.items() if key not in ("name", "standard_error")}
    for key, value in entries.items():
        yield f"{key} = {_any(value)}"
    if all(np.ndim(value) < 2 for value in entries.values()):
        errors = ", ".join(f"{key} = {_any(value)}" for key, value in table["standard_error"].items())
        yield f"standard_error = {{ {errors} }}"
        return
    yield "[effect.standard_error]"
    for key, value in table["standard_error"].items():
        yield f"{key} = {_any(value)}"


def _any(value: Any) -> str:
    """Return a number, a list of numbers or a matrix as TOML."""
    return (_value, _row, _matrix)[np.ndim(value)](value)


def _value(number: float, digits: int = DIGITS) -> str:
    """Return a number as TOML with `digits` significant digits, always as a float and never as -0."""
    return _given(float(f"{number:.{digits}g}") + 0.0)


def _given(number: float) -> str:
    """Return a number as TOML with all its digits."""
    return repr(float(number))


def _row(values: Sequence[float], digits: int = DIGITS) -> str:
    return f"[{', '.join(_value(value, digits) for value in values)}]"


def _rows(values: Sequence[Sequence[float]]) -> str:
    return f"[{', '.join(_row(row) for row in values)}]"


def _matrix(values: Sequence[Sequence[float]]) -> str:
    """Return a matrix with a line per row; off-diagonal rounding errors become 0."""
    matrix = np.asarray(values, float)
    size = np.sqrt(np.abs(np.outer(np.diag(matrix), np.diag(matrix))))
    clean = np.where(np.abs(matrix) < 1e-6 * size, 0.0, matrix)
    return "\n".join(["[", *(f"  {_row(row)}," for row in clean.tolist()), "]"])


def _full(matrix: Sequence[Sequence[float]]) -> bool:
    """Return whether a matrix has off-diagonal entries other than 0."""
    values = np.asarray(matrix)
    return bool(np.any(values != np.diag(np.diag(values))))


def _comment(words: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(words, WIDTH - 2)]
