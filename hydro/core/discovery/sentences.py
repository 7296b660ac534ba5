"""Descriptions of discovered force terms in sentences for engineers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from hydro.core.columns import DOF, VELOCITY
from hydro.core.effects.formula import AXES, amounts
from hydro.core.effects.layout import COMMAND_NAMES
from hydro.core.evaluation.remaining_force import SAME_POWER

OFFSETS = {
    ("Y", "N"): (1.0, "ahead of"),
    ("Z", "M"): (-1.0, "ahead of"),
    ("Y", "K"): (-1.0, "below"),
    ("X", "M"): (1.0, "below"),
}
"""For a force and a moment axis: sign of the lever arm (N = x Y, M = -x Z, K = -z Y, M = z X), direction."""
AGAINST = {"ahead of": "aft of", "below": "above"}
OF_DOWN = {"g_x": "pitch", "g_y": "roll", "g_z": "being upright"}


def told(table: Mapping[str, Any], errors: Mapping[str, Any]) -> str:
    """Return the terms of a discovered formula in words, separated by semicolons.

    A force and a moment with the same law are described together, as a force with a point of action.

    `errors` are standard errors of the numbers, in the form of `table`.
    """
    found = amounts(table)
    spread = [powers for _, _, powers in amounts({**table, **errors})]
    parts, done = [], set[int]()
    for number, (text, value, powers) in enumerate(found):
        if number in done:
            continue
        said = _sentence(text, value, powers, spread[number])
        for other, (moment, turning, its) in enumerate(found):
            lever = _lever((text, value, powers), (moment, turning, its))
            if lever is not None and other not in done:
                done.add(other)
                said += f" and acts {lever} CO"
        parts.append(said)
    return "; ".join(parts)


def _sentence(text: str, value: float, powers: Sequence[float], spread: Sequence[float]) -> str:
    """Describe one term.

    Args:
        text: The term as in a vehicle file.
        value: Coefficient.
        powers: Fitted powers.
        spread: Standard errors of the powers.
    """
    axis, *factors = text.split()
    dof, own = DOF[AXES.index(axis)], VELOCITY[AXES.index(axis)]
    what = "force" if axis in "XYZ" else "moment"
    grown = [f"{p:.2f} +- {e:.2g}" for p, e in zip(powers, spread, strict=True)]
    if not factors:
        return f"a steady {what} in {dof}"
    if factors[0] in COMMAND_NAMES:
        return f"command {factors[0]} causes a {what} in {dof}"
    if factors[0] in OF_DOWN:
        return f"a {what} in {dof} depends on {OF_DOWN[factors[0]]}"
    names = [factor.strip("|^n").removeprefix("sgn(").rstrip(")") for factor in factors]
    odd = factors[-1].startswith("sgn") or len(factors) == 2
    if powers and names[-1] in COMMAND_NAMES:
        turns = " and changes sign with it" if names[0] == names[-1] else ""
        return f"command {names[-1]} causes a {what} in {dof} that grows as |{names[0]}|^{grown[0]}{turns}"
    if powers and names == [own, own]:
        kind = "drag" if value < 0.0 else "a force along the motion"
        return f"{kind} in {dof} grows as |{own}|^{grown[0]}"
    if powers and len(factors) == 2 and names[1] == own and not factors[1].startswith("sgn"):
        kind = "raises" if value < 0.0 else "lowers"
        return f"{DOF[VELOCITY.index(names[0])]} {kind} the drag in {dof}, as |{names[0]}|^{grown[0]} {own}"
    law = " ".join(f.replace("^n", f"^{grown[0]}") if grown else f for f in factors)
    if odd and len(set(names)) == 1:
        cause = DOF[VELOCITY.index(names[0])]
        return (
            f"{cause} causes a {what} in {dof} that grows as |{names[0]}|^{grown[0]} and changes sign with it"
        )
    return f"a {what} in {dof} is proportional to {law}"


def _lever(
    force: tuple[str, float, tuple[float, ...]], moment: tuple[str, float, tuple[float, ...]]
) -> str | None:
    """Return in words where a force acts, if a moment term has the same law as the force term; else None."""
    (text, value, powers), (other, turning, its) = force, moment
    sign, way = OFFSETS.get((text[0], other[0]), (0.0, ""))
    if not sign or not value or text[1:] != other[1:] or text[1:].startswith((" g", " z")):
        return None
    if any(abs(a - b) > SAME_POWER for a, b in zip(powers, its, strict=True)):
        return None
    arm = sign * turning / value
    return f"{abs(arm):.2f} m {way if arm > 0.0 else AGAINST[way]}" if math.isfinite(arm) else None
