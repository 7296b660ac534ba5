"""Small learners of soft actor-critic with random transitions, to test with."""

from __future__ import annotations

import numpy as np

from hydro.rl.environment.encoding import Encoding
from hydro.rl.training.config import SACConfig
from hydro.rl.training.sac import Learner

SMALL = SACConfig(layers=(16, 16), batch=32, capacity=500, horizon=3)
ENCODING = Encoding(
    np.array([1.0, 2.0, 4.0, 1.0, 1.0], dtype=np.float32), np.array([False, False, False, True, False])
)


def learner(choices=SMALL, seed=0, rows=200):
    made = Learner(ENCODING, 2, choices, seed)
    feed(made, rows)
    return made


def feed(made, rows, seed=0):
    rng = np.random.default_rng(seed)
    for _ in range(rows // 8):
        made.remember(
            rng.standard_normal((8, 5)).astype(np.float32),
            rng.uniform(-1, 1, (8, 2)).astype(np.float32),
            rng.standard_normal(8).astype(np.float32),
            rng.random(8) < 0.2,
            rng.random(8) < 0.1,
            rng.standard_normal((8, 5)).astype(np.float32),
        )
