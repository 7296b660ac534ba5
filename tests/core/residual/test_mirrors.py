"""Motions in the mirrors of a hull: signs, symmetric sums, and growth beyond what was seen."""

from __future__ import annotations

import numpy as np
import pytest
from sim.trained import trained

from hydro.core.residual.mirrors import AXES, MIRRORS, PORT, PRODUCTS, SIGNED, parities, products
from hydro.core.residual.network import Network


def test_images_are_what_planes_of_symmetry_make_of_twists_and_wrenches():
    for signs in MIRRORS:
        mirror = np.diag(signs[:3])  # v is a vector; omega, of r x v, turns with the determinant besides
        np.testing.assert_array_equal(signs[3:], np.linalg.det(mirror) * signs[:3])
    assert MIRRORS[PORT].tolist() == [1.0, -1.0, 1.0, -1.0, 1.0, -1.0]
    assert len({tuple(signs) for signs in MIRRORS}) == 8
    np.testing.assert_array_equal(MIRRORS[0], np.ones(AXES))


def test_parities_are_what_the_images_make_of_products():
    z = np.random.default_rng(0).normal(size=(5, AXES))
    for signs, parity in zip(MIRRORS, parities(), strict=True):
        both = np.hstack([z, products(z)])
        np.testing.assert_array_equal(np.hstack([z * signs, products(z * signs)]), both * parity)
    assert products(z).shape == (5, PRODUCTS)


def alone(sum_number: int) -> Network:
    """A network with one kind of radial function alone, about CO."""
    _, model = trained("gp", points=5)
    weights = np.zeros_like(model.tensors["weights"])
    weights[:, 1, sum_number] = 10.0 * model.tensors["weights"][:, 1, sum_number]
    model.tensors["weights"] = weights
    for name in ("linear", "library", "steering"):
        model.tensors[name] = np.zeros_like(model.tensors[name])
    return Network.of(model)


def apart(network: Network, signs: np.ndarray) -> float:
    """How far the wrench of an image is from the image of the wrench, of its size."""
    nu = np.random.default_rng(1).normal(size=(30, AXES)) * 0.5
    still = np.zeros_like(nu)
    wrench = network.wrench(np.hstack([nu, still]))
    image = network.wrench(np.hstack([nu * signs, still]))
    return float(abs(image - wrench * signs).max() / abs(wrench).max())


@pytest.mark.parametrize(("number", "symmetric"), [(0, range(8)), (1, (0, PORT)), (2, (0,))])
def test_each_sum_has_its_own_symmetry(number, symmetric):
    network = alone(number)
    for image, signs in enumerate(MIRRORS):
        if image in symmetric:
            assert apart(network, signs) < 1e-6
        else:
            assert apart(network, signs) > 0.01


def test_beyond_what_was_seen_the_wrench_grows_as_the_square():
    _, model = trained("gp", points=5)
    model.tensors["top"] = np.array([1.5], np.float32)
    network = Network.of(model)
    direction = np.random.default_rng(2).normal(size=AXES)
    fast = 1e3 * direction / np.linalg.norm(direction)
    one, two = network.wrench([*fast, *np.zeros(6)]), network.wrench([*(2.0 * fast), *np.zeros(6)])
    np.testing.assert_allclose(two, 4.0 * one, rtol=1e-5)
    assert np.isfinite(one).all()


def test_the_centre_moves_motion_and_wrench_alike():
    _, model = trained("gp", points=5)
    nu = np.random.default_rng(3).normal(size=(10, AXES))
    centre = np.array([0.3, -0.2, 0.1])
    model.tensors["centre"] = centre.astype(np.float32)
    moved = Network.of(model).wrench(np.hstack([nu, np.zeros_like(nu)]))
    model.tensors["centre"] = np.zeros(3, np.float32)
    there = np.hstack([nu[:, :3] + np.cross(nu[:, 3:], centre), nu[:, 3:]])
    wrench = Network.of(model).wrench(np.hstack([there, np.zeros_like(nu)]))
    wrench[:, 3:] += np.cross(centre, wrench[:, :3])
    np.testing.assert_allclose(moved, wrench, rtol=1e-5, atol=1e-4)


def test_drag_is_steered_by_where_force_and_moment_point():
    _, model = trained("gp", points=5)
    nu = np.random.default_rng(4).normal(size=(20, AXES)) * 0.5
    states = np.hstack([nu, np.zeros_like(nu)])
    steering = model.tensors["steering"].copy()
    model.tensors["steering"] = np.zeros_like(steering)
    plain = Network.of(model).wrench(states)
    for name in ("linear", "library"):  # the second stage as the first, without what is no drag
        model.tensors[name] = model.tensors[name][[0, 0]]
    model.tensors["library"] = model.tensors["library"].copy()
    model.tensors["library"][:, 1, SIGNED:] = 0.0
    model.tensors["weights"] = model.tensors["weights"][:, [0, 0]]
    drag = Network.of(model).wrench(states)
    model.tensors["steering"] = steering
    more = Network.of(model).wrench(states) - drag
    for half in (slice(0, 3), slice(3, 6)):
        part = drag[:, half]
        size = np.linalg.norm(part, axis=1, keepdims=True)
        np.testing.assert_allclose(
            more[:, half], part * (abs(part) @ steering[half].T) / size, rtol=1e-4, atol=1e-3
        )
    assert abs(plain - drag).max() > 0.1
