"""Effects of the surroundings: a tether, and suction near the surface."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.case import Case, Quantity
from hydro.core.effects.layout import CENTER_OF_BUOYANCY, POSITION, ROTATION
from hydro.core.effects.phrases import Entry, changed, coordinates, undetermined
from hydro.core.effects.record import (
    Advice,
    Effect,
    Identification,
    Index,
    Parameter,
    Rest,
    Shape,
    Table,
)
from hydro.core.effects.restoring import PAYLOAD, push_at, push_down
from hydro.core.effects.shapes import LEVER, along
from hydro.core.effects.units import of_weight
from hydro.core.effects.wording import compass, listed, place, quantity
from hydro.core.effects.words import HEADINGS, TILTS
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.plausible import Plausible, between, within_box
from hydro.core.vehicle.plausible import of_weight as up_to_weight

LITTLE = 0.01  # share of the significant stiffness in a column
FAR = 1e4
"""Distance of an anchor with a practically constant pull [m]."""
STEADY = 1e3
"""Distance above which the direction of an anchor is stated instead of its place [m]."""
STEEP = 80.0
"""Slope above which a pull is called vertical [deg]."""
DECAYS = (0.5, 1.5, 4.0)  # m, decay depths that are tried
LEAST_DECAY, SHALLOWEST, DEEPEST = 1e-3, 0.1, 30.0


@kernel
def tether(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Pull k max(0, distance - slack) at the attachment toward the anchor, straight, massless, undamped.

    k is the stiffness, the distance that from attachment to anchor.  The pull is the negative gradient of 1/2
    k max(0, distance - slack)^2, so it conserves energy.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    stiffness, slack = p[0], p[1]
    ax, ay, az = p[2], p[3], p[4]
    lx = p[5] - s[POSITION] - (s[ROTATION] * ax + s[ROTATION + 1] * ay + s[ROTATION + 2] * az)
    ly = p[6] - s[POSITION + 1] - (s[ROTATION + 3] * ax + s[ROTATION + 4] * ay + s[ROTATION + 5] * az)
    lz = p[7] - s[POSITION + 2] - (s[ROTATION + 6] * ax + s[ROTATION + 7] * ay + s[ROTATION + 8] * az)
    distance = math.sqrt(lx * lx + ly * ly + lz * lz)
    if distance <= slack or distance == 0.0:
        return
    pull = stiffness * (distance - slack) / distance
    fx = pull * (s[ROTATION] * lx + s[ROTATION + 3] * ly + s[ROTATION + 6] * lz)
    fy = pull * (s[ROTATION + 1] * lx + s[ROTATION + 4] * ly + s[ROTATION + 7] * lz)
    fz = pull * (s[ROTATION + 2] * lx + s[ROTATION + 5] * ly + s[ROTATION + 8] * lz)
    push_at(fx, fy, fz, ax, ay, az, tau)


@kernel
def surface_suction(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Force A exp(-max(z, 0)/decay) upward in the world at the centre of buoyancy, z the depth of CO.

    A hull that moves close below a free surface is drawn toward it, more strongly at smaller depth (an
    empirical law).

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    force = p[0] * math.exp(-max(s[POSITION + 2], 0.0) / p[1])
    at = CENTER_OF_BUOYANCY
    push_down(s, -force, c[at], c[at + 1], c[at + 2], tau)


def on_the_hull(index: Index, rest: Rest) -> tuple[float, float]:
    """Return the bounds of a coordinate of a tether's attachment in a fit [m]: a hull length from CO.

    Args:
        index: Not used.
        rest: Vehicle without the fitted effect, for the length of its hull.
    """
    return -rest.vehicle.hull.length, rest.vehicle.hull.length


def cables(vehicle: Vehicle, reach: Array | None) -> list[Table]:
    """Return `[[effect]]` tables of `tether`, initial values of fits.

    Anchors are in the middle of the recorded track, at its first row and at its edges.  Each anchor has two
    tables: one cable is always taut, the other only on the far half of the track.

    Args:
        vehicle: The vehicle, whose weight sets the stiffness.
        reach: Positions [m] and times [s] of the recording, (N, 4); None without a recording.
    """
    track = np.zeros((1, 3)) if reach is None else reach[:, :3]
    middle, half = np.median(track, axis=0), np.maximum(0.5 * np.ptp(track, axis=0), 2.0)
    anchors = [middle, track[0]]
    anchors += [middle + sign * half[i] * np.eye(3)[i] for i in range(3) for sign in (-1.0, 1.0)]
    found = []
    for anchor in anchors:
        distance = np.linalg.norm(track - anchor, axis=1)
        for slack in np.quantile(distance, [0.0, 0.5]):
            found.append(_cable(of_weight(0.002)(vehicle), float(slack), np.zeros(3), anchor))
    return found


def without_slack(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
    """Yield one `Shape`: tables of `tether` without slack whose forces add up to that of any taut cable.

    Without slack the force is k (anchor - position), k the stiffness.  It is linear in k and in k times the
    anchor's coordinates, so a linear fit of seven amounts suffices.  Four tables have the anchor in the
    middle of the recorded track, and beside it in north, east and down; three displace the attachment on the
    body along x, y and z.

    Args:
        vehicle: The vehicle, which sets the size of stiffness and displacement.
        reach: Positions [m] and times [s] of the recording, (N, 4); None without a recording, whose track is
            then the origin.
    """
    length, stiffness = vehicle.hull.length, TETHER.parameter("k").scale_at((), vehicle)
    lever, held = LEVER * length, np.array(cables(vehicle, reach)[0]["anchor"])
    side = max(float(np.ptp(reach[:, :3], axis=0).max()), 2.0) if reach is not None else 2.0

    def cable(k: float, anchor: Array, attachment: Array) -> Table:
        return _cable(k, 0.0, attachment, anchor)

    def begin(amounts: Array) -> Table:
        stiff = max(float(amounts.sum()), 1e-3)
        anchor = held + np.clip(amounts[1:4] / stiff, -3.0, 3.0) * side
        attachment = np.clip(np.clip(amounts[4:] / stiff, -4.0, 4.0) * lever, -length, length)
        return cable(stiff * stiffness, anchor, attachment)

    little = LITTLE * stiffness
    tables = [cable(little, held + side * way, np.zeros(3)) for way in (np.zeros(3), *np.eye(3))]
    tables += [cable(little, held, lever * way) for way in np.eye(3)]
    yield Shape(tuple(tables), (LITTLE,) * 7, begin)


def with_slack(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
    """Yield trial shapes of `tether`, one for each anchor and slack of `cables`.

    A shape is a linear problem with four columns: the stiffness k, and k times the attachment's three
    coordinates.

    Args:
        vehicle: The vehicle.
        reach: Positions [m] and times [s] of the recording, (N, 4); None without a recording.
    """
    length, stiffness = vehicle.hull.length, TETHER.parameter("k").scale_at((), vehicle)
    lever = LEVER * length
    for start in cables(vehicle, reach):

        def cable(k: float, attachment: Array, start: Table = start) -> Table:
            return _cable(k, start["slack"], attachment, np.array(start["anchor"]))

        def begin(amounts: Array, cable: Callable[[float, Array], Table] = cable) -> Table:
            stiff = max(float(amounts.sum()), 1e-3)
            return cable(stiff * stiffness, np.clip(amounts[1:] / stiff * lever, -length, length))

        tables = tuple(cable(LITTLE * stiffness, lever * way) for way in (np.zeros(3), *np.eye(3)))
        yield Shape(tables, (LITTLE,) * 4, begin)


def steady_pull(force: float, way: Array, attachment: Array) -> Table:
    """Return a new `[[effect]]` table of a tether whose anchor is so far away that its pull is constant.

    Args:
        force: Pull [N].
        way: Unit vector of the direction, NED, (3,).
        attachment: Point on the body, FRD from CO, (3,) [m].
    """
    return _cable(force / FAR, 0.0, attachment, FAR * way)


def _cable(k: float, slack: float, attachment: Array, anchor: Array) -> Table:
    return {
        "name": TETHER.name,
        "k": k,
        "slack": slack,
        "attachment": attachment.tolist(),
        "anchor": anchor.tolist(),
    }


def shallow_to_deep(index: Index, rest: Rest) -> tuple[float, float]:
    """Return the least and greatest decay depth that a recording can show [m].

    Args:
        index: Not used.
        rest: Not used.
    """
    return SHALLOWEST, DEEPEST


def absent(decay: float) -> Table:
    """Return a new `[[effect]]` table of `surface_suction` with zero force and a given decay depth [m]."""
    return {"name": SURFACE_SUCTION.name, "A": 0.0, "decay": decay}


def suctions(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
    """Yield trial shapes of `surface_suction`, one for each decay depth of DECAYS.

    Each shape is a linear problem with one column, the force at the surface.

    Args:
        vehicle: The vehicle.
        reach: Not used.
    """
    for decay in DECAYS:
        yield along(SURFACE_SUCTION, "A", absent(decay), vehicle)


def hung_weight(table: Mapping[str, Any], vehicle: Vehicle) -> list[Table]:
    """Return one simpler effect, a new `[[effect]]` table: a payload that pulls as the tether does at NED 0.

    A tether with a far anchor above or below pulls as a weight or a float at the attachment.

    Args:
        table: The tether's parameters: stiffness `k` [N/m], `slack`, `attachment` and `anchor` [m].
        vehicle: Not used.
    """
    anchor = np.asarray(table["anchor"], float)
    distance = float(np.linalg.norm(anchor))
    pull = table.get("k", 0.0) * max(distance - table.get("slack", 0.0), 0.0)
    place = np.asarray(table.get("attachment", np.zeros(3)), float).tolist()
    weight = pull * float(anchor[2]) / max(distance, 1e-9)
    return [{"name": PAYLOAD.name, "w": weight} | dict(zip(("x", "y", "z"), place, strict=True))]


def tether_sentence(case: Case) -> str:
    """Return a sentence that states stiffness, slack and anchor of a tether, or a constant pull.

    A pull is constant if the anchor is farther away than STEADY.
    """
    stiffness, slack = case.one("k"), case.one("slack")
    anchor, point = case.many("anchor", (3,)), case.many("attachment", (3,))
    if case.in_file:
        entries = [
            Entry("the stiffness of the tether", "", stiffness, "N/m"),
            Entry("the tether's slack", "", slack, "m"),
        ]
        axes = zip(("north", "east", "down"), anchor, strict=True)
        entries += [Entry(f"the {axis} coordinate of the anchor", "", one, "m") for axis, one in axes]
        entries += coordinates("the attachment's", point)
        return changed(case, "the tether", entries)
    if not stiffness.clear:
        return undetermined(case, "the stiffness of a tether", stiffness.text("N/m"))
    north, east, down = (one.value for one in anchor)
    where = place([one.value for one in point], [one.error for one in point])
    distance = math.hypot(north, east, down)
    if distance > STEADY:
        pull = stiffness.times(max(distance - slack.value, 0.0)).size("N")
        return f"A steady pull of {pull} {direction(north, east, down)} acts on the vehicle at {where}."
    loose = f" beyond {slack.text('m')} of slack" if slack.value > 0.0 else ""
    pull = f"{stiffness.text('N/m')}{loose}"
    return f"A tether at {where} pulls with {pull} toward its anchor at {fixed_point(anchor)}."


def direction(north: float, east: float, down: float) -> str:
    """Return words for a direction: `toward 323° (NW)`, `20° downward toward 323° (NW)`, or `downward`.

    Args:
        north: Component toward north, in any unit.
        east: Component toward east, in the same unit.
        down: Component downward, in the same unit.
    """
    level, tilt = math.hypot(north, east), math.degrees(math.atan2(abs(down), math.hypot(north, east)))
    vertical = "downward" if down > 0.0 else "upward"
    if not level or tilt > STEEP:
        return vertical
    return f"{f'{tilt:.0f}° {vertical} ' if tilt >= 1.0 else ''}toward {compass(north, east)}"


def fixed_point(point: Sequence[Quantity]) -> str:
    """Return words for a point of the world by its distances from the NED origin: `3 m north`.

    Args:
        point: Its three coordinates north, east and down [m], with standard errors.
    """
    sides = (("north", "south"), ("east", "west"), ("down", "up"))
    return listed(
        [
            f"{quantity(abs(one.value), one.error, 'm').partition(' (±')[0]} {pair[one.value < 0.0]}"
            for one, pair in zip(point, sides, strict=True)
        ]
    )


def suction_sentence(case: Case) -> str:
    """Return a sentence that states the suction force at the surface and its decay depth."""
    force, decay = case.one("A"), case.one("decay")
    if case.in_file:
        entries = [
            Entry("the upward force at the surface", "", force, "N"),
            Entry("the depth of its decay", "", decay, "m"),
        ]
        return changed(case, "the suction of the surface", entries)
    if not force.clear:
        return undetermined(case, "the suction of the surface", force.text("N"))
    verb = "pulls the vehicle up" if force.value > 0.0 else "pushes the vehicle down"
    deep = f"decaying to 37 % at {decay.text('m')} depth"
    return f"The surface {verb} with {force.size('N')} at zero depth, {deep}."


TETHER = Effect(
    name="tether",
    repeatable=True,
    family="surroundings",
    kind="wrench",
    definition="k max(0, distance - slack) toward the anchor, at the attachment",
    source="Hooke's law for a straight massless cable",
    excitation="excursions beyond the slack in several directions",
    lookalikes=("ocean_current", "net_buoyancy"),
    parameters=(
        Parameter(
            "k",
            ("N/m",),
            "stiffness",
            low=0.0,
            scale=(of_weight(0.005),),
            plausible=Plausible(
                lambda index, vehicle: (0.0, of_weight(1.0)(vehicle)),
                "up to the vehicle's weight per metre",
                "slack-laid cables give way",
            ),
        ),
        Parameter(
            "slack",
            ("m",),
            "length before it pulls",
            low=0.0,
            scale=(5.0,),
            plausible=between(0.0, FAR, "m", "lengths of tethers"),
        ),
        Parameter(
            "attachment",
            ("m",),
            "point on the body",
            (3,),
            limits=on_the_hull,
            plausible=within_box(2.0, "either way up to the hull's length along each axis", "mounting"),
        ),
        Parameter(
            "anchor",
            ("m",),
            "fixed end, NED",
            (3,),
            required=True,
            scale=(10.0,),
            plausible=between(-FAR, FAR, "m", "lengths of tethers, from where NED begins"),
        ),
    ),
    kernel=tether,
    sentence=tether_sentence,
    identification=Identification(
        step=1e-2, starts=cables, coarse=without_slack, fine=with_slack, plainer=hung_weight
    ),
    advice=Advice(parted_by=(HEADINGS,)),
)
SURFACE_SUCTION = Effect(
    name="surface_suction",
    family="surroundings",
    kind="wrench",
    definition="A exp(-max(z, 0)/decay) upward in the world at the centre of buoyancy",
    source="empirical: free-surface effects decay exponentially with depth",
    excitation="slow passages at several depths near the surface",
    lookalikes=("net_buoyancy",),
    parameters=(
        Parameter(
            "A",
            ("N",),
            "force at the surface",
            plausible=up_to_weight(
                0.3, "either way up to 0.3 of the vehicle's weight", "what thrusters hold for long"
            ),
        ),
        Parameter(
            "decay",
            ("m",),
            "depth over which it falls to 1/e",
            low=LEAST_DECAY,
            required=True,
            scale=(1.0,),
            limits=shallow_to_deep,
            plausible=between(SHALLOWEST, DEEPEST, "m", "a part of the hull's length to some lengths"),
        ),
    ),
    kernel=surface_suction,
    sentence=suction_sentence,
    identification=Identification(
        starts=lambda vehicle, reach: [absent(decay) for decay in DECAYS], coarse=suctions
    ),
    advice=Advice(parted_by=(TILTS,)),
)

EFFECTS = (
    TETHER,
    SURFACE_SUCTION,
)
