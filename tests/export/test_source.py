"""Extraction of source code with all called functions into one module."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.effects import damping, hull, layout
from hydro.core.errors import HydroError
from hydro.export.source import Bundle

SIZE = 3


def doubled(x: list[float], out: list[float]) -> None:
    """Return twice a vector, at most SIZE of it."""
    count: int = min(x.size, SIZE)
    for i in range(count):
        out[i] = 2.0 * x[i + layout.RELATIVE_VELOCITY]


def test_constants_modules_and_sizes_come_along():
    bundle = Bundle()
    assert bundle.add(doubled, "twice") == "twice"
    text, namespace = bundle.text(), {}
    assert "import hydro" not in text
    assert "Return twice a vector" in text
    exec(text, namespace)
    out = [0.0, 0.0]
    namespace["twice"]([1.0, 2.5], out)
    assert out == [2.0, 5.0]


def test_two_of_one_name_are_kept_apart():
    bundle = Bundle()
    assert bundle.add(damping.linear, "drag") == "drag"
    assert bundle.add(damping.quadratic, "drag") == "damping_drag"
    assert bundle.add(damping.linear) == "drag"


def test_what_cannot_be_written_out_is_refused():
    def f() -> float:
        return float(np.pi)

    with pytest.raises(HydroError, match="f uses np, which cannot be written out"):
        Bundle().add(f)


def test_a_kernel_alone_does_what_the_compiled_one_does():
    bundle, namespace = Bundle(), {}
    name = bundle.add(hull.body_lift)
    exec(bundle.text(), namespace)
    rng = np.random.default_rng(0)
    p, c, s = (rng.normal(size=size) for size in (8, layout.CONSTANTS, layout.MOTION))
    compiled, plain = np.zeros(6), [0.0] * 6
    hull.body_lift(p, c, s, np.zeros(0), np.zeros(0), compiled)
    namespace[name](p.tolist(), c.tolist(), s.tolist(), [], [], plain)
    np.testing.assert_allclose(plain, compiled, rtol=1e-12)
