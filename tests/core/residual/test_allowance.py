"""Evidence beside what a hull may do: against the whole normal equations, and on hulls that no file has."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import damped, moved

from hydro.core.diagnosis.model import fit_model, unfitted
from hydro.core.identification.levenberg_marquardt import Prior
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import free
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.residual.allowance import FACTORS, TEMPERS, Allowance
from hydro.core.residual.library import AXES

FILE = damped()
HULL = {"name": "cross_axis_drag", "D01": 8.0, "D10": 6.0, "D12": 5.0, "D21": 7.0}
"""What the hull does beside its file."""
ROWS = 4000


def shots(*effects, seed=0):
    record = recording(FILE, moved(damped(*effects), rows=ROWS, seed=seed))
    return make_shots(record, sigma=np.full(12, 1e-3))


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10_000), st.integers(1, 4))
def test_evidence_is_that_of_the_whole_normal_equations(seed: int, count: int):
    """The library's unknowns beside the effect's, in one matrix, for every factor and temper."""
    rng = np.random.default_rng(seed)
    library, columns, error = rng.normal(size=(60, 7)), rng.normal(size=(60, count)), rng.normal(size=60)
    error += 3.0 * library @ rng.normal(size=7) + columns @ rng.normal(size=count)
    away, information = rng.normal(size=count), rng.uniform(0.1, 2.0, count)
    sizes, axes = np.linalg.eigh(library.T @ library)
    both = np.column_stack([columns, error])
    allowance = Allowance(None, np.ones(3), np.zeros((3, 20, 12)), np.zeros((3, 20, 7)), sizes, 20.0)
    evidence, step, spread, left = allowance._integrated(
        both.T @ both, axes.T @ library.T @ both, away, Prior(np.zeros(count), information)
    )

    def whole(factor: float, temper: float) -> tuple[float, np.ndarray, np.ndarray, float]:
        x, scale = np.column_stack([library, columns]), AXES / (20.0 * temper)
        known = np.concatenate([np.full(7, factor**-2), information])
        matrix = scale * x.T @ x + np.diag(known)
        pull = scale * x.T @ error - np.concatenate([np.zeros(7), information * away])
        found = np.linalg.solve(matrix, pull)
        misfit = scale * error @ error + information @ away**2 - pull @ found
        wide = np.linalg.slogdet(matrix)[1] - np.log(known).sum()
        value = -0.5 * (AXES * 3.0 * np.log(temper) + misfit + wide)
        return value, found[7:], np.linalg.inv(matrix)[7:, 7:], temper

    best, found, errors, temper = max((whole(f, t) for f in FACTORS for t in TEMPERS), key=lambda one: one[0])
    assert evidence == pytest.approx(best, rel=1e-8)
    assert left == temper
    assert step == pytest.approx(found, rel=1e-5, abs=1e-8)
    assert spread == pytest.approx(errors, rel=1e-5, abs=1e-10)


def held(allowance: Allowance, measured, effect: str, begin: dict | str):
    """How an effect stands, about its fit without the allowance; and that fit's values."""
    problem = OutputError(measured).at_measured_states(FILE)
    unknown = free(FILE, [begin])
    fit = fit_model(FILE, [begin], problem, measured.record.track, 12)
    prior = Prior(np.zeros(len(fit.values)), np.full(len(fit.values), 0.25))
    assert [entry.effect for entry in unknown.entries] == [effect] * len(fit.values)
    begun = allowance.held(fit.unknown, fit.values, prior)
    return fit.values, allowance.refined(fit.unknown, begun, prior, most=6, gain=0.5)


def alone(allowance: Allowance) -> float:
    nothing = unfitted(FILE, OutputError(allowance.shots)).unknown
    return allowance.held(nothing, np.zeros(0), Prior(np.zeros(0), np.zeros(0))).evidence


def test_values_do_not_take_up_what_the_hull_does():
    """Drag that the file lacks slows a vehicle as thrust that is lost with speed does: a fit takes it so."""
    truth = damped({"name": "thruster_inflow", "c": 0.1})
    drag = {"name": "quadratic_damping", "diagonal": [140.0, 330.0, 480.0, 13.0, 55.0, 40.0]}
    rest = tuple(table for table in truth.effect if table["name"] != "quadratic_damping")
    record = recording(FILE, moved(msgspec.structs.replace(truth, effect=(*rest, drag)), rows=ROWS))
    measured = make_shots(record, sigma=np.full(12, 1e-3))
    fitted, found = held(Allowance.of(FILE, measured), measured, "thruster_inflow", "thruster_inflow")
    assert abs(fitted[0] - 0.1) > 0.05
    assert found.best[0] == pytest.approx(0.1, abs=0.6 * abs(fitted[0] - 0.1))


def test_what_is_there_has_evidence_and_what_bends_to_the_hull_has_little():
    measured = shots(HULL, {"name": "thruster_asymmetry", "a": 0.2})
    allowance = Allowance.of(FILE, measured)
    _, there = held(allowance, measured, "thruster_asymmetry", "thruster_asymmetry")
    _, bent = held(allowance, measured, "thruster_lag", {"name": "thruster_lag", "dT": 0.05})
    assert there.evidence - alone(allowance) > 30.0
    assert there.evidence - bent.evidence > 30.0


def test_an_unchanged_hull_gives_no_evidence_for_thrust_and_weight():
    measured = shots(HULL)
    allowance = Allowance.of(FILE, measured)
    for name in ("thruster_asymmetry", "net_buoyancy"):
        assert held(allowance, measured, name, name)[1].evidence - alone(allowance) < 5.0


def test_a_prediction_that_diverges_has_no_evidence():
    measured = shots()
    unknown = free(FILE, ["linear_damping"])
    prior = Prior(np.zeros(6), np.full(6, 0.25))
    mad = Allowance.of(FILE, measured).held(unknown, np.full(6, -1e5), prior)
    assert mad.evidence == -np.inf
