"""Units become dimensions, and dimensions sizes: held against the laws by which such sizes scale."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from bench import BARE

from hydro.core.effects import CATALOGUE, Parameter
from hydro.core.effects.units import Dimension, dimension, plain_size
from hydro.core.vehicle.description import Vehicle


def grown(factor: float) -> Vehicle:
    """The bare vehicle of the same density, so many times as long."""
    body, hull = BARE.rigid_body, BARE.hull
    inertia = tuple(tuple(factor**5 * v for v in row) for row in body.inertia)
    return msgspec.structs.replace(
        BARE,
        rigid_body=msgspec.structs.replace(body, mass=factor**3 * body.mass, inertia=inertia),
        hull=msgspec.structs.replace(hull, length=factor * hull.length),
    )


@pytest.mark.parametrize(
    ("unit", "powers"),
    [
        ("1", (0, 0, 0, 0)),
        ("rad", (0, 0, 0, 1)),
        ("1/s", (0, 0, -1, 0)),
        ("N", (1, 1, -2, 0)),
        ("kg m^2", (1, 2, 0, 0)),
        ("N m s", (1, 2, -1, 0)),
        ("N s^3/m^3", (1, -2, 1, 0)),
        ("N m s^2/rad^2", (1, 2, 0, -2)),
        ("N s/m/rad", (1, 0, -1, -1)),
    ],
)
def test_a_unit_is_powers_of_base_units(unit, powers):
    assert dimension(unit) == Dimension(*powers)


@pytest.mark.parametrize("unit", ["", "kn", "N m^", "m^-1", "N*m", "m/", "kg m^0.5"])
def test_what_is_no_unit_is_refused_when_the_record_is_made(unit):
    with pytest.raises(ValueError, match="is none of 1, kg, m"):
        Parameter("a", (unit,), "no unit")


@pytest.mark.parametrize(
    ("unit", "power"),
    [
        ("kg", 3),
        ("kg m", 4),
        ("kg m^2", 5),
        ("kg m^3", 6),
        ("N", 3),
        ("N m", 4),
        ("N/m", 2),
        ("N s^3/m^3", 3),
        ("N m s^3", 5),
        ("m", 1),
        ("1/m", -1),
        ("m/s", 0),
        ("s/m", 0),
        ("rad", 0),
        ("1", 0),
    ],
)
def test_sizes_grow_with_the_vehicle_as_its_inertia_does(unit, power):
    assert plain_size(unit, grown(2.0)) == pytest.approx(2.0**power * plain_size(unit, BARE), rel=1e-12)


@pytest.mark.parametrize(
    ("one", "other"), [("N s/m", "kg/s"), ("N s^2/m", "kg"), ("N m s^2", "kg m^2"), ("N s", "kg m/s")]
)
def test_a_size_does_not_depend_on_how_a_unit_is_written(one, other):
    assert plain_size(one, BARE) == plain_size(other, BARE)


def test_every_entry_of_the_catalogue_has_a_size():
    for effect in CATALOGUE.values():
        for parameter in effect.parameters:
            lengths = [n if isinstance(n, int) else 1 for n in parameter.shape]
            sizes = [parameter.scale_at(index, BARE) for index in np.ndindex(*lengths)]
            assert np.isfinite(sizes).all()
            assert min(sizes) > 0.0
            assert len(parameter.scale) in (0, len(parameter.unit))
