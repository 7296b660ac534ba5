"""Positions on the globe as metres about the first fix."""

from __future__ import annotations

import io

import numpy as np
import polars as pl
import pytest

import hydro
from hydro.core.errors import DataError
from hydro.core.guessing.aliases import guess
from hydro.core.logs.geodesy import EQUATOR, FLATTENING, metres
from hydro.io import logmap

MAP = """
[time]
column = "t"
[position]
latitude = "lat"
longitude = "lon"
depth = "depth"
[commands]
columns = ["c"]
"""


def cartesian(latitude: np.ndarray, longitude: np.ndarray) -> np.ndarray:
    """Return places on the ellipsoid, (n, 3) [m]."""
    phi, lam = np.radians(latitude), np.radians(longitude)
    square = FLATTENING * (2.0 - FLATTENING)
    radius = EQUATOR / np.sqrt(1.0 - square * np.sin(phi) ** 2)
    level = radius * np.cos(phi)
    return np.stack(
        [level * np.cos(lam), level * np.sin(lam), radius * (1.0 - square) * np.sin(phi)], axis=-1
    )


@pytest.mark.parametrize("place", [(0.0, 10.0), (63.4, 10.4), (-33.0, 179.9999), (78.2, -15.6)])
def test_metres_are_those_of_the_ellipsoid(place):
    rng = np.random.default_rng(0)
    latitude = place[0] + np.r_[0.0, rng.uniform(-0.002, 0.002, 50)]
    longitude = place[1] + np.r_[0.0, rng.uniform(-0.005, 0.005, 50)]
    longitude = np.where(longitude > 180.0, longitude - 360.0, longitude)
    north, east = metres(latitude, longitude, place)
    phi, lam = np.radians(place)
    axes = np.array([
        [-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)],
        [-np.sin(lam), np.cos(lam), 0.0],
    ])  # fmt: skip
    way = cartesian(latitude, longitude)
    expected = (way - way[0]) @ axes.T
    np.testing.assert_allclose(np.stack([north, east], axis=1), expected, atol=0.15, rtol=1e-3)


def imported(**columns: np.ndarray):
    t = np.arange(200) * 0.1
    every = {"t": t, "lat": 63.4 + t * 1e-6, "lon": 10.4 - t * 2e-6, "depth": 1.0 + 0.0 * t, "c": 0.0 * t}
    frame = pl.DataFrame({**every, **columns})
    return hydro.import_log(io.BytesIO(frame.write_csv().encode()), logmap.parse(MAP))


def test_a_recording_by_latitude_and_longitude():
    frame, report = imported()
    assert frame["x"][0] == frame["y"][0] == 0.0
    np.testing.assert_allclose(frame["x"][100], 1e-5 * 111_470.0, rtol=1e-3)
    np.testing.assert_allclose(frame["y"][100], -2e-5 * 49_960.0, rtol=2e-3)
    assert (frame["z"] == 1.0).all()
    assert (
        "north and east of the first fix [deg] of stdin 63.4000000, 10.4000000" in report.imported.notes[-1]
    )


def test_zeros_before_the_first_fix_are_none():
    late = np.arange(200) < 30
    t = np.arange(200) * 0.1
    frame, _ = imported(lat=np.where(late, 0.0, 63.4 + t * 1e-6), lon=np.where(late, 0.0, 10.4))
    assert frame["x"][0] == 0.0
    assert frame["x"].max() < 3.0


def test_names_of_fixes_are_guessed_beside_a_depth():
    names = ["time", "/gps/fix.latitude", "/gps/fix.longitude", "/bar30/depth.data"]
    assert guess(names)["position"] == {"latitude": names[1], "longitude": names[2], "depth": names[3]}
    assert guess(names[:3]).get("position") is None


@pytest.mark.parametrize("key", ['columns = ["a", "b"]', 'world = "ENU"', 'height = "h"'])
def test_what_does_not_go_with_latitudes_is_refused(key):
    with pytest.raises(DataError, match=r"position.*latitude and longitude"):
        logmap.parse(MAP.replace('depth = "depth"', f'depth = "depth"\n{key}'))
