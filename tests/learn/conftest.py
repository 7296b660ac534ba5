"""Small split table whose labels are the damping of a vehicle with known coefficients."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np
import polars as pl
import pytest

from hydro.core.distillation.features import INPUTS, OUTPUTS
from hydro.learn import gaussian_process

LINEAR = np.array([15.0, 40.0, 60.0, 5.0, 10.0, 8.0])
QUADRATIC = np.array([95.0, 260.0, 380.0, 10.0, 40.0, 30.0])
MASS = np.diag([186.0, 271.0, 311.0, 9.0, 28.0, 28.0])
SPREAD = np.array([0.6, 0.5, 0.5, 0.5, 0.4, 0.5, 1.0, 1.0, 1.0, 1.5, 1.0, 1.0])
BLOCK = 50


def wrench(states: np.ndarray) -> np.ndarray:
    """Return C(nu) nu + D(nu) nu (N, 6) of a vehicle with a diagonal M (Fossen theorem 3.2, 6.57, 6.66)."""
    nu = states[:, :6]
    linear, angular = nu[:, :3] @ MASS[:3, :3], nu[:, 3:] @ MASS[3:, 3:]
    coriolis = np.hstack(
        [np.cross(nu[:, 3:], linear), np.cross(nu[:, :3], linear) + np.cross(nu[:, 3:], angular)]
    )
    return coriolis + LINEAR * nu + QUADRATIC * np.abs(nu) * nu


@pytest.fixture
def short_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fit Gaussian processes to few rows: their time grows with the cube of the rows."""
    monkeypatch.setattr(gaussian_process, "ROWS_VARIANCES", 80)
    monkeypatch.setattr(gaussian_process, "ROWS_CENTRE", 60)
    monkeypatch.setattr(gaussian_process, "STEPS", 4)


@pytest.fixture(scope="session")
def table() -> Callable[..., pl.DataFrame]:
    """Return a function that makes split tables: random states around rest, blocks in cyclic `parts`."""

    def make(count: int = 2000, seed: int = 0, parts: tuple[str, ...] = ("train", "train", "test", "guard")):
        states = np.random.default_rng(seed).normal(size=(count, 12)) * SPREAD
        number = np.arange(count) // BLOCK
        ids = [hashlib.sha256(f"{seed} {block}".encode()).hexdigest() for block in range(number[-1] + 1)]
        return pl.DataFrame(
            dict(zip((*INPUTS, *OUTPUTS), np.hstack([states, wrench(states)]).T, strict=True))
        ).with_columns(
            session=pl.lit("s"),
            t=pl.Series(0.02 * np.arange(count)),
            block=pl.Series([ids[block] for block in number]),
            part=pl.Series([parts[block % len(parts)] for block in number]),
        )

    return make
