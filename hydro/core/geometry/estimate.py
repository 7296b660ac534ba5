"""Estimate of a whole vehicle from the hull's box or mesh, the mass and the thrusters, with standard errors.

Every hydrodynamic parameter has a standard error, which a fit and a diagnosis use as the width of a prior.
The centre of buoyancy is that of the box, or of the mesh's volume.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.damping import LINEAR_DAMPING, QUADRATIC_DAMPING
from hydro.core.effects.hull import BODY_LIFT
from hydro.core.effects.inertia import ADDED_MASS, ADDED_MASS_COUPLING
from hydro.core.effects.record import Effect
from hydro.core.errors import DataError
from hydro.core.geometry import hull_drag, hull_inertia
from hydro.core.geometry.hull_form import Form, Shape, form_of, uniform_inertia
from hydro.core.geometry.solid import Solid
from hydro.core.vehicle import ellipsoid
from hydro.core.vehicle.description import (
    Battery,
    Buoyancy,
    Environment,
    Hull,
    Matrix3,
    RigidBody,
    Thruster,
    Vector3,
    Vehicle,
)

HEIGHT = 0.05
"""Default distance of the centre of gravity below the centre of buoyancy, relative to the hull's height."""
INERTIA_ERROR = 0.3
"""Relative standard error of the moments of inertia of a uniform body."""
RADIATED = (0.2, 0.2, 0.2, 0.5, 0.3, 0.3)
"""Relative standard errors of the added mass computed from a mesh, which omits thrusters and frames, (6,)."""
COUPLED = 0.5
"""Standard error of an off-diagonal entry, relative to the geometric mean of the errors of its two axes."""
FIN_ERROR = 0.6
"""Relative standard error of the effects of tail fins of assumed size."""


@dataclass(frozen=True)
class Known:
    """Data of a vehicle that the user gives for an estimate of its file.

    Attributes:
        name: Name of the vehicle.
        mass: Dry mass [kg].
        sides: Length, width, height [m] of the hull's box; not used if there is a mesh.
        thrusters: Thrusters in the order of a log's commands.
        buoyancy: Buoyant force [N]; None for a neutral vehicle.
        gravity_center: Centre of gravity [m] from CO, FRD; None for a place below the centre of buoyancy.
        buoyancy_center: Centre of buoyancy [m] from CO, FRD; None for that of the box or of the mesh's
            volume.
        metacentric_height: Height [m] of the centre of buoyancy over that of gravity; None for HEIGHT times
            the hull's height, or for the height that the two given centres have.
        inertia: Moments of inertia (3,) [kg m^2] about the centre of gravity; None for a uniform body.
        shape: One of `hull_form.SHAPES`; None to decide by proportions.
        fins: Whether a torpedo-shaped hull has tail fins of usual size.
        density: Water density [kg/m^3].
        gravity: Acceleration of gravity [m/s^2].
        voltage: Nominal supply voltage [V] if thrust curves depend on it; else None.
    """

    name: str
    mass: float
    sides: tuple[float, float, float]
    thrusters: tuple[Thruster, ...] = ()
    buoyancy: float | None = None
    gravity_center: Vector3 | None = None
    buoyancy_center: Vector3 | None = None
    metacentric_height: float | None = None
    inertia: Vector3 | None = None
    shape: Shape | None = None
    fins: bool = True
    density: float = 1025.0
    gravity: float = 9.81
    voltage: float | None = None


@dataclass(frozen=True)
class Estimate:
    """Estimated vehicle, with the origin of its numbers.

    Attributes:
        vehicle: The vehicle; its effects have standard errors.
        form: Geometric form that represents the hull.
        origins: A sentence for each of `inertia`, `gravity`, `buoyancy` and every effect: how it was
            estimated.
    """

    vehicle: Vehicle
    form: Form
    origins: Mapping[str, str] = field(default_factory=dict)


def estimate(
    known: Known, hull: Solid | None = None, mesh: str | None = None, radiated: Array | None = None
) -> Estimate:
    """Return an estimated vehicle, with standard errors of its hydrodynamic parameters.

    Args:
        known: Data that the user gives.
        hull: Solid of the hull mesh, if there is a mesh.
        mesh: File name of the mesh, to write into the vehicle file.
        radiated: Added-mass matrix of the mesh about CO, (6, 6), from `radiated_added_mass`; None for that of
            an ellipsoid with the mesh's volume and moments.

    Raises:
        DataError: A number is not possible; the message names the number.
    """
    _check(known)
    sides = known.sides if hull is None else hull.sides
    displaced = (known.buoyancy or known.mass * known.gravity) / known.gravity
    form = form_of(tuple(sides), displaced, known.density, known.shape, known.fins and hull is None)
    middle = np.zeros(3) if hull is None else hull.middle
    buoyancy_center, gravity_center, origins = _centers(known, form, hull)
    inertia, inertia_errors, origins["inertia"] = _inertia(known, form, hull)
    added, origins[ADDED_MASS.name] = _added_mass(form, hull, radiated, inertia_errors)
    tables = [added, *_fin_tables(form, origins), *_drag(form, origins)]
    length, width, height = (float(side) for side in form.sides)
    vehicle = Vehicle(
        name=known.name,
        environment=Environment(known.density, known.gravity),
        rigid_body=RigidBody(known.mass, gravity_center, _matrix3(inertia)),
        buoyancy=Buoyancy(displaced * known.gravity, buoyancy_center),
        hull=Hull(length, width, height, _vector3(middle), mesh),
        battery=None if known.voltage is None else Battery(known.voltage),
        thruster=known.thrusters,
        effect=tuple(tables),
    )
    return Estimate(vehicle, form, origins)


def _check(known: Known) -> None:
    """Refuse data of a vehicle with impossible numbers."""
    positive = {"mass": known.mass, "water density": known.density, "gravity": known.gravity}
    if known.buoyancy is not None:
        positive["buoyancy"] = known.buoyancy
    if known.voltage is not None:
        positive["voltage"] = known.voltage
    for name, value in positive.items():
        if not np.isfinite(value) or value <= 0.0:
            raise DataError(f"{name}: must be a positive, finite number, got {value:g}")
    given = (known.gravity_center, known.buoyancy_center, known.metacentric_height)
    if all(value is not None for value in given):
        raise DataError("metacentric height: the two centres say it already: leave one of the three out")
    if known.metacentric_height is not None and not abs(known.metacentric_height) < np.inf:
        raise DataError(f"metacentric height: must be finite, got {known.metacentric_height:g}")
    if known.inertia is not None:
        least, middle, most = sorted(known.inertia)
        if least <= 0.0 or most > least + middle:
            shown = ", ".join(f"{value:g}" for value in known.inertia)
            raise DataError(f"inertia: no body has {shown}: all above 0, none above the sum of the other two")


def _centers(known: Known, form: Form, hull: Solid | None) -> tuple[Vector3, Vector3, dict[str, str]]:
    """Return the centres of buoyancy and gravity [m], FRD from CO, and their origins in words."""
    lever = known.metacentric_height
    said = (
        "given" if lever is not None else f"a guess, {HEIGHT:.0%} of the hull's height: measure it by a tilt"
    )
    down = np.array([0.0, 0.0, HEIGHT * form.sides[2] if lever is None else lever])
    own = np.zeros(3) if hull is None else hull.center
    place = "the middle of the hull's box" if hull is None else "the centroid of the mesh's volume"
    gravity, buoyancy = known.gravity_center, known.buoyancy_center
    if buoyancy is None:
        by_lever = gravity is not None and lever is not None
        buoyancy = _vector3(np.asarray(gravity) - down) if by_lever else _vector3(own)
        place = "over the centre of gravity, by the height given" if by_lever else place
    else:
        place = "given"
    below = "given" if gravity is not None else f"below the centre of buoyancy; the height is {said}"
    gravity = gravity if gravity is not None else _vector3(np.asarray(buoyancy) + down)
    return buoyancy, gravity, {"gravity": below, "buoyancy": place}


def _inertia(known: Known, form: Form, hull: Solid | None) -> tuple[Array, Array, str]:
    """Return the inertia matrix (3, 3), the standard errors of its diagonal (3,), and its origin in words."""
    if known.inertia is not None:
        return np.diag(known.inertia), np.zeros(3), "given"
    if hull is not None:
        matrix, body = hull.inertia(known.mass), "the mesh"
    else:
        matrix = np.diag(uniform_inertia(form, known.mass))
        body = (
            "a torpedo as full as its displacement" if form.shape == "torpedo" else "the ellipsoid in the box"
        )
    said = f"a uniform body: {body}; about {INERTIA_ERROR:.0%}, which the errors of the added mass include"
    return matrix, INERTIA_ERROR * np.diag(matrix), said


def _added_mass(
    form: Form, hull: Solid | None, radiated: Array | None, body: Array
) -> tuple[dict[str, Any], str]:
    """Return the effect table of the added mass, and its origin in words.

    Args:
        form: Form of the hull.
        hull: Solid of the mesh, or None.
        radiated: Computed added mass of the mesh, (6, 6), or None.
        body: Standard errors of the dry moments of inertia, (3,) [kg m^2].
    """
    if hull is None:
        diagonal = hull_inertia.added_mass(form)
        errors = hull_inertia.added_mass_errors(form, diagonal, body)
        said = {
            "torpedo": "Lamb's k-factors (1932, art. 114-115) times mass and second moment of a body as "
            "full as its displacement"
            + ("; tail fins by slender-body theory (Nielsen 1960)" if form.fins else ""),
            "ellipsoid": "Lamb's k-factors (1932, art. 114-115) times displaced mass and inertia",
            "box": f"solid box (DNV-RP-C205, tables D-1 and D-2) times the fullness {form.fullness:.2g}",
        }[form.shape]
        return _table(ADDED_MASS, diagonal=(diagonal, errors)), said
    if radiated is not None:
        matrix, relative = radiated, RADIATED
        said = "boundary elements on the mesh, unbounded water (Capytaine)"
    else:
        matrix = ellipsoid.added_mass_matrix(
            tuple(hull.semi_axes), form.density, tuple(float(x) for x in hull.center)
        )
        relative = hull_inertia.ERRORS["ellipsoid"]
        said = "the ellipsoid of the mesh's volume and moments, Lamb's k-factors (1932, art. 114-115)"
    errors = hull_inertia.added_mass_errors(form, np.diag(matrix), body, relative)
    between = COUPLED * np.sqrt(np.outer(errors, errors))
    np.fill_diagonal(between, errors)
    return _table(ADDED_MASS, matrix=(matrix, between)), said


def _fin_tables(form: Form, origins: dict[str, str]) -> list[dict[str, Any]]:
    """Return the effect tables of a torpedo's tail fins: added-mass coupling and lift; empty without fins."""
    if not form.fins:
        return []
    fins = "four tail fins of usual size (tips one diameter off the axis, chord half a diameter)"
    coupling, lift, x = hull_inertia.fin_mass(form) * form.tail, hull_drag.fin_lift(form), form.tail
    origins[ADDED_MASS_COUPLING.name] = f"{fins}: their added mass times their station"
    origins[BODY_LIFT.name] = (
        f"{fins}: 1/2 rho c_L A, c_L by aspect ratio (Hoerner; Prestero 2001, chapter 4)"
    )
    # Fins have equal lift in both planes; the sign of x differs between them.
    lifts = {
        **{"L11": lift, "L15": x * lift, "L51": x * lift, "L55": x * x * lift},
        **{"L22": lift, "L24": -x * lift, "L42": -x * lift, "L44": x * x * lift},
    }
    couplings = {"M15": coupling, "M24": -coupling}
    return [
        _table(effect, **{key: (value, FIN_ERROR * abs(value)) for key, value in values.items()})
        for effect, values in ((ADDED_MASS_COUPLING, couplings), (BODY_LIFT, lifts))
    ]


def _drag(form: Form, origins: dict[str, str]) -> list[dict[str, Any]]:
    """Return the effect tables of linear and quadratic damping."""
    quadratic = hull_drag.quadratic_drag(form)
    linear = hull_drag.linear_drag(form, quadratic)
    errors, linear_errors = hull_drag.drag_errors(form, quadratic, linear)
    origins[LINEAR_DAMPING.name] = (
        f"equal to the quadratic where the hull moves at {hull_drag.SLOW:g} m/s; uncertain by its own size"
    )
    origins[QUADRATIC_DAMPING.name] = (
        "1/2 rho C_d A, C_d of blocks and plates (DNV-RP-C205, appendix E); about the axes integrated over "
        "the faces"
        if form.shape == "box"
        else "1/2 rho C_d A: a streamlined body along (Hoerner, ch. 6), elliptic strips across (DNV-RP-C205, "
        "appendix E), about the axes integrated over the length"
    )
    return [
        _table(LINEAR_DAMPING, diagonal=(linear, linear_errors)),
        _table(QUADRATIC_DAMPING, diagonal=(quadratic, errors)),
    ]


def _table(effect: Effect, **values: tuple[Any, Any]) -> dict[str, Any]:
    """Return the table of an effect for a vehicle file, from pairs of value and standard error."""
    plain = {key: np.asarray(value, float).tolist() for key, (value, _) in values.items()}
    errors = {key: np.asarray(error, float).tolist() for key, (_, error) in values.items()}
    return {"name": effect.name, **plain, "standard_error": errors}


def _vector3(values: Array) -> Vector3:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _matrix3(values: Array) -> Matrix3:
    a, b, c = (_vector3(row) for row in values)
    return a, b, c
