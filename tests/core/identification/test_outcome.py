"""Which entries of a fit the data determine, and which they confuse: problems with chosen covariances."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import damped

from hydro.core.identification.levenberg_marquardt import PRIOR
from hydro.core.identification.outcome import Fit, with_response_error, with_uncertainty
from hydro.core.identification.prior import KNOWN
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.parameters import free


def found(errors, values, correlation=0.0, **options) -> Fit:
    """A fit of linear damping, standard errors and values in its scales; correlation of entries 0 and 1."""
    unknown = free(damped(), ["linear_damping"])
    spread = np.diag(np.square(errors).astype(float))
    spread[0, 1] = spread[1, 0] = correlation * errors[0] * errors[1]
    gram = np.zeros((1, 7, 7))
    gram[0, :6, :6] = np.linalg.inv(spread) - PRIOR**-2 * np.eye(6)
    gram[0, 6, 6] = 60.0
    normal = Normal(gram, 60, np.full((1, 12), 5.0), np.zeros((1, 0, 7)))
    fit = with_uncertainty(unknown, np.array(values) * unknown.scales, normal, 1.0, "equation", **options)
    np.testing.assert_allclose(fit.standard_errors / unknown.scales, errors, rtol=1e-6)
    return fit


@pytest.mark.parametrize(
    ("error", "value", "determined"),
    [
        (0.49, 0.1, True),  # small beside the scale
        (0.51, 0.1, False),
        (0.51, 2.95 * 0.51, False),
        (0.51, 3.05 * 0.51, True),  # large, but three of it is less than the value
        (0.295 * PRIOR, PRIOR, True),
        (0.305 * PRIOR, PRIOR, False),  # hardly less than was known beforehand
    ],
)
def test_an_entry_is_determined_by_its_standard_error_or_by_a_plain_value(error, value, determined):
    fit = found([0.1, 0.1, 0.1, error, 0.1, 0.1], [1.0, 1.0, 1.0, value, 1.0, 1.0])
    assert fit.determined.tolist() == [True] * 3 + [determined] + [True] * 2
    told = [line for line in fit.warnings if line.startswith("not determined by these data: ")]
    assert [line.partition(";")[0][30:] for line in told] == ["linear_damping.diagonal[3]"] * (not determined)


@pytest.mark.parametrize(("correlation", "told"), [(0.9945, None), (0.9957, "+0.996"), (-0.9957, "-0.996")])
def test_entries_whose_estimates_are_all_but_one_are_told(correlation, told):
    fit = found([0.1] * 6, [1.0] * 6, correlation)
    lines = [line for line in fit.warnings if "hardly be separated" in line]
    assert bool(lines) == bool(told)
    if told:
        assert lines[0].startswith("linear_damping.diagonal[1] and linear_damping.diagonal[0] ")
        assert lines[0].endswith(f"(correlation {told})")


def test_entries_that_are_not_determined_are_not_called_confused():
    fit = found([0.6] * 6, [0.5] * 6, 0.9955)
    assert not fit.determined.any()
    assert not [line for line in fit.warnings if "be separated" in line]


def test_least_standard_errors_widen_the_covariance_and_keep_its_correlations():
    unknown = free(damped(), ["linear_damping"])
    plain = found([0.1] * 6, [1.0] * 6, 0.5)
    gram = np.zeros((1, 7, 7))
    gram[0, :6, :6] = np.linalg.inv(plain.covariance / np.outer(unknown.scales, unknown.scales))
    gram[0, :6, :6] -= PRIOR**-2 * np.eye(6)
    gram[0, 6, 6] = 60.0
    least = unknown.scales * [0.3, 0.05, 0.1, 0.1, 0.1, 0.2]
    normal = Normal(gram, 60, np.full((1, 12), 5.0), np.zeros((1, 0, 7)))
    wide = with_uncertainty(unknown, plain.values, normal, 1.0, "equation", least=least)
    np.testing.assert_allclose(
        wide.standard_errors / unknown.scales, [0.3, 0.1, 0.1, 0.1, 0.1, 0.2], rtol=1e-6
    )
    correlation = wide.covariance[0, 1] / wide.standard_errors[0] / wide.standard_errors[1]
    assert correlation == pytest.approx(0.5, rel=1e-6)


def test_a_force_is_known_no_better_than_the_inertia_of_the_file():
    """A place and a value that did not change keep their standard errors."""
    file = damped()
    table = {"name": "payload", "w": 8.0, "mass": 2.0, "x": 0.3, "y": 0.0, "z": 0.1}
    unknown = free(file, [table])
    count, names = len(unknown.entries), [entry.parameter for entry in unknown.entries]
    gram = 1e4 * np.eye(count + 1)[None]
    normal = Normal(gram, 60, np.full((1, 12), 5.0), np.zeros((1, 0, count + 1)))
    plain = with_uncertainty(unknown, unknown.starts[0], normal, 1.0, "output")
    fit = with_response_error(plain, file)
    size = np.array([{"w": 8.0, "mass": 2.0}.get(name, 0.0) for name in names])
    np.testing.assert_allclose(fit.standard_errors, np.hypot(plain.standard_errors, KNOWN / 2.0 * size))
    again = with_response_error(plain, plain.vehicle)
    np.testing.assert_allclose(again.standard_errors, plain.standard_errors)
