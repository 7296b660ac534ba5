"""A tether on a vehicle that is turned about all axes."""

from __future__ import annotations

import numpy as np
from bench import R, force_at, wrench

ETA = np.array([1.0, -2.0, 3.0, 0.4, -0.3, 2.0])
ANCHOR, ATTACHMENT = np.array([6.0, 1.0, -0.5]), np.array([0.5, 0.3, -0.2])


def test_a_tether_pulls_from_its_attachment_straight_toward_the_anchor():
    line = ANCHOR - ETA[:3] - R(ETA) @ ATTACHMENT
    pull = 7.0 * (np.linalg.norm(line) - 2.0) * line / np.linalg.norm(line)
    tether = {"name": "tether", "k": 7.0, "slack": 2.0}
    places = {"attachment": ATTACHMENT.tolist(), "anchor": ANCHOR.tolist()}
    np.testing.assert_allclose(
        wrench(tether | places, ETA, np.zeros(6)), force_at(ATTACHMENT, pull, ETA), rtol=1e-12
    )
