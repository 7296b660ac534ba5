"""The panel method against closed-form volumes and surface integrals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import DataError
from hydro.core.vehicle.panels import FORM_DRAG, SKIN_FRICTION, panel_wrench, panels, superellipsoid
from hydro.io.mesh import read_obj

RHO = 1025.0
velocity = st.floats(-3.0, 3.0, allow_subnormal=False)
twists = st.tuples(*[velocity] * 6).map(np.array)
size = st.floats(0.05, 5.0)


def box(length, width, height, *, center=(0.0, 0.0, 0.0), divisions=1):
    """A box whose six faces are grids of squares, every square two triangles."""
    vertices, faces = [], []
    grid = np.linspace(-0.5, 0.5, divisions + 1)
    for axis in range(3):
        for side in (-0.5, 0.5):
            for i in range(divisions):
                for j in range(divisions):
                    corners = np.empty((4, 3))
                    corners[:, axis] = side
                    corners[:, (axis + 1) % 3] = grid[[i, i + 1, i + 1, i]]
                    corners[:, (axis + 2) % 3] = grid[[j, j, j + 1, j + 1]]
                    start = len(vertices)
                    vertices += list(corners if side > 0 else corners[::-1])
                    faces += [(start, start + 1, start + 2), (start, start + 2, start + 3)]
    return np.array(vertices) * [length, width, height] + np.asarray(center), np.array(faces)


def sphere(radius, divisions=24):
    vertices, faces = box(2, 2, 2, divisions=divisions)
    return radius * vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces


@given(size, size, size, st.tuples(velocity, velocity, velocity))
def test_box_has_its_volume_and_centroid_wherever_it_is(length, width, height, center):
    hull = panels(*box(length, width, height, center=center))
    assert hull.volume == pytest.approx(length * width * height, rel=1e-9)
    assert hull.center == pytest.approx(np.array(center), abs=1e-8 * (1 + 1 / min(length, width, height)))
    assert hull.extent == pytest.approx([length, width, height])
    area = hull.table[6].sum()
    assert area == pytest.approx(2 * (length * width + width * height + height * length))
    np.testing.assert_allclose(hull.table[3:6] @ hull.table[6], 0.0, atol=1e-9 * area)


def test_tetrahedron_volume_and_centroid():
    corners = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4]])
    hull = panels(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    assert hull.volume == pytest.approx(4.0)
    assert hull.center == pytest.approx([0.5, 0.75, 1.0])


def test_sphere_volume():
    assert panels(*sphere(0.7)).volume == pytest.approx(4 / 3 * np.pi * 0.7**3, rel=5e-3)


@given(size, size, size, st.floats(-3, 3))
def test_box_ahead_or_astern_feels_its_end_and_the_friction_of_its_sides(length, width, height, u):
    hull = panels(*box(length, width, height))
    sides = 2 * length * (width + height)
    drag = 0.5 * RHO * u * abs(u) * (FORM_DRAG * width * height + SKIN_FRICTION * sides)
    expected = [-drag, 0, 0, 0, 0, 0]
    assert panel_wrench(hull, [u, 0, 0, 0, 0, 0], RHO) == pytest.approx(
        expected, abs=1e-9 + 1e-12 * abs(drag)
    )


def test_sphere_drag_is_its_surface_integral():
    """Form: int cos^3 over the front, C_p/2; friction: int |v_t| v_t . e, 3 pi/4 C_f; both of pi R^2."""
    R, U = 0.4, 1.7
    expected = 0.5 * RHO * U**2 * np.pi * R**2 * (FORM_DRAG / 2 + 3 * np.pi / 4 * SKIN_FRICTION)
    drag = -panel_wrench(panels(*sphere(R, 40)), [U, 0, 0, 0, 0, 0], RHO)[0]
    assert drag == pytest.approx(expected, rel=2e-3)


def test_spinning_sphere_feels_friction_alone():
    """N = -1/2 rho C_f r |r| int R^3 sin^3 dA = -1/2 rho C_f r |r| 2 pi R^5 3 pi/8."""
    R, r = 0.4, -2.0
    wrench = panel_wrench(panels(*sphere(R, 40)), [0, 0, 0, 0, 0, r], RHO)
    expected = 0.5 * RHO * SKIN_FRICTION * r**2 * 2 * np.pi * R**5 * 3 * np.pi / 8
    assert wrench[5] == pytest.approx(expected, rel=5e-3)
    np.testing.assert_allclose(wrench[:5], 0, atol=1e-3 * expected)


def test_yawing_thin_plate_is_the_integral_of_local_pressure():
    """A plate in the x-z plane turning at r: v = r x, N = -2 * 1/2 rho C_p H r^2 int_0^{L/2} x^3 dx."""
    L, H, r = 2.0, 0.5, 1.3
    plate = panels(*box(L, 1e-4, H, divisions=60))
    moment = -panel_wrench(plate, [0, 0, 0, 0, 0, r], RHO)[5]
    assert moment == pytest.approx(0.5 * RHO * FORM_DRAG * H * r**2 * 2 * (L / 2) ** 4 / 4, rel=2e-3)


@given(twists)
def test_fluid_only_takes_power(nu_r):
    hull = panels(*superellipsoid(1.4, 0.7, 0.5, (0.3, -0.1, 0.2)))
    assert panel_wrench(hull, nu_r, RHO) @ nu_r <= 1e-9


@given(twists)
def test_kernel_is_the_sum_over_facets(nu_r):
    """The same equations on arrays, in another order."""
    hull = panels(*superellipsoid(1.4, 0.7, 0.5, (0.3, -0.1, 0.2)))
    r, n, area = hull.table[:3].T, hull.table[3:6].T, hull.table[6]
    v = nu_r[:3] + np.cross(nu_r[3:], r)
    normal = (v * n).sum(axis=1)
    tangential = v - normal[:, None] * n
    pressure = 0.5 * RHO * FORM_DRAG * area * np.clip(normal, 0, None) ** 2
    shear = 0.5 * RHO * SKIN_FRICTION * area * np.linalg.norm(tangential, axis=1)
    force = -pressure[:, None] * n - shear[:, None] * tangential
    expected = [*force.sum(axis=0), *np.cross(r, force).sum(axis=0)]
    np.testing.assert_allclose(panel_wrench(hull, nu_r, RHO), expected, rtol=1e-9, atol=1e-9)


@given(twists)
def test_superellipsoid_mirrors_port_and_starboard_and_bow_and_stern(nu_r):
    hull = panels(*superellipsoid(1.4, 0.7, 0.5))
    for signs in ([1, -1, 1, -1, 1, -1], [-1, 1, 1, 1, -1, -1], [1, 1, -1, -1, -1, 1]):
        mirrored = panel_wrench(hull, nu_r * signs, RHO) * signs
        np.testing.assert_allclose(mirrored, panel_wrench(hull, nu_r, RHO), rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize(("length", "width", "height"), [(1.4, 0.7, 0.5), (1.6, 0.19, 0.19)])
def test_superellipsoid_fills_its_bounding_box_by_a_known_share(length, width, height):
    hull = panels(*superellipsoid(length, width, height, (1, 2, 3), along=60, around=80))
    assert hull.extent == pytest.approx([length, width, height])
    assert hull.center == pytest.approx([1, 2, 3])
    x = np.linspace(0, 1, 20001)
    y = np.linspace(0, 1, 20001)
    section = np.trapezoid((1 - y**2.5) ** 0.4, y)  # quarter of the cross-section in its unit square
    share = section * np.trapezoid((1 - x**4) ** 0.5, x)
    assert hull.volume == pytest.approx(share * length * width * height, rel=0.01)


def test_same_bits_every_time():
    hull = panels(*superellipsoid(1.4, 0.7, 0.5))
    nu_r = np.array([1.1, -0.3, 0.2, 0.4, -0.2, 0.7])
    first = panel_wrench(hull, nu_r, RHO)
    assert all(np.array_equal(panel_wrench(hull, nu_r, RHO), first) for _ in range(20))


def test_stonefish_hull_has_the_volume_its_owner_gives(stonefish):
    hull = panels(*read_obj(stonefish / "hull.obj"))
    assert hull.volume == pytest.approx(0.1477590219, rel=1e-6)
    assert hull.center == pytest.approx([0.01999997, 0, -0.02], abs=1e-6)


def test_surfaces_that_enclose_nothing_are_refused():
    vertices, faces = box(1, 1, 1)
    with pytest.raises(DataError, match="inside out"):
        panels(vertices, faces[:, ::-1])
    with pytest.raises(DataError, match="3 open edges"):
        panels(vertices, faces[1:])
    flipped = faces.copy()
    flipped[0] = flipped[0][::-1]
    with pytest.raises(DataError, match="anticlockwise"):
        panels(vertices, flipped)
    with pytest.raises(DataError, match="twice"):
        panels(vertices, np.concatenate([faces, faces]))
    with pytest.raises(DataError, match="at least 4 faces"):
        panels(vertices, faces[:3])
    with pytest.raises(DataError, match="vertex 99 of 24"):
        panels(vertices, np.concatenate([faces, [[0, 1, 98]]]))
    broken = vertices.copy()
    broken[2, 1] = np.nan
    with pytest.raises(DataError, match="vertex 3 is not finite"):
        panels(broken, faces)
    with pytest.raises(DataError, match=r"\(V, 3\)"):
        panels(vertices[:, :2], faces)
    for wrong in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(DataError, match="positive, finite length"):
            superellipsoid(1.0, wrong, 1.0)


def write(path, text):
    path.write_text(text)
    return path


def test_obj_quads_slashes_comments_and_negative_numbers(tmp_path):
    text = "# a cube\no cube\n" + "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))
    text += "vn 0 0 1\nf 1/1/1 2/2/1 4/3/1 3/4/1 # left\nf 5 7 8 6\nf 1 5 6 2\n"
    text += "f 3 4 8 7\nf 1 3 7 5\nf -7 -3 -1 -5\n"
    hull = panels(*read_obj(write(tmp_path / "cube.obj", text)))
    assert hull.volume == pytest.approx(1.0)
    assert hull.table.shape == (7, 12)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("v 0 0\n", "line 1"),
        ("v 0 0 zero\n", "line 1"),
        ("v 0 0 0\nf 1 1\n", "line 2"),
        ("v 0 0 0\nf 1 2 3\n", "line 2"),
        ("v 0 0 0\nf 0 1 1\n", "line 2"),
        ("", "empty file"),
        ("v 0 0 0\n", "holds no faces"),
    ],
)
def test_broken_obj_files_say_where(tmp_path, text, complaint):
    with pytest.raises(DataError, match=complaint) as error:
        read_obj(write(tmp_path / "hull.obj", text))
    assert "hull.obj" in str(error.value)


def test_unreadable_obj_files(tmp_path):
    with pytest.raises(DataError, match="no such file or folder"):
        read_obj(tmp_path / "absent.obj")
    (tmp_path / "binary.obj").write_bytes(bytes(range(128, 256)))
    with pytest.raises(DataError, match="not a text file"):
        read_obj(tmp_path / "binary.obj")
