"""Maps of logs: how a sensor sits in the vehicle."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hydro.core.errors import DataError
from hydro.io import logmap

MAP = """
[time]
column = "t"
[velocity]
columns = ["u", "v", "w"]
[velocity.mount]
matrix = {}
[commands]
columns = ["cmd_1"]
"""


@pytest.mark.parametrize("angles", [(0.0, 0.0, 45.0), (180.0, 0.0, 0.0), (10.0, -20.0, 130.0)])
def test_a_mount_may_be_any_rotation_and_nothing_else(angles: tuple[float, float, float]):
    R = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    found = logmap.parse(MAP.format(R.tolist())).velocity
    assert found is not None
    np.testing.assert_array_equal(found.mount.matrix, R)
    for wrong in (-R, 1.1 * R, R[:2], np.pad(R, ((0, 0), (0, 1))), R[:, :2]):
        with pytest.raises(DataError, match=r"velocity\.mount\.matrix: "):
            logmap.parse(MAP.format(wrong.tolist()))
