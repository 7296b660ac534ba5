"""Fits of a search stay near the values of the file, as far as the recording allows."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from benchmarks.hidden_effects.vehicles import preset
from benchmarks.judge.studies import LISTS
from hydro.core.diagnosis.baseline import refit, stable_start
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.search import Search
from hydro.core.identification.levenberg_marquardt import PRIOR
from hydro.core.identification.prior import KNOWN, about_file, greatest_change
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.parameters import free
from hydro.core.progress import silent


def test_the_prior_is_centred_on_the_file_and_lets_new_effects_start_anywhere():
    file = preset("bluerov2_heavy")
    unknown = free(file, ["linear_damping", "net_buoyancy"])
    moved = unknown.holding(unknown.starts[0], np.zeros(len(unknown.entries), bool))
    prior = about_file(file, ["linear_damping"], moved)
    own = np.array([entry.effect == "linear_damping" for entry in unknown.entries])
    given = np.array(file.effects("linear_damping")[0]["diagonal"]) / unknown.scales[own]
    np.testing.assert_allclose(prior.centre[own], given)
    np.testing.assert_allclose(prior.information[own], (KNOWN * np.maximum(np.abs(given), 1.0)) ** -2.0)
    np.testing.assert_allclose(prior.information[~own], PRIOR**-2)


@pytest.mark.parametrize(("chi2", "factor"), [(0.9, 1.0), (40.0, 40.0), (np.inf, 1.0)])
def test_a_wrong_model_does_not_outweigh_the_file(chi2, factor):
    file = preset("bluerov2_heavy")
    prior = about_file(file, ["linear_damping"], free(file, ["linear_damping"]))
    np.testing.assert_allclose(prior.at(chi2).information, factor * prior.information)


@pytest.mark.parametrize("seed", [370011, 370014])
def test_a_hidden_current_does_not_make_the_hull_of_a_torpedo_absurd(seed, tmp_path):
    """A controller holds the torpedo in a current of half a metre per second, which the file lacks.

    Without a prior, the refit of the file's effects ended at 180 to 760 deviations from the file's values.
    """
    study = LISTS["logs:station-keeping-in-a-current"].prepare(seed, 60.0, tmp_path)
    log = preprocess(study.given, study.measured)
    start, shots = stable_start(study.given, log)
    refitted = refit(study.given, log, shots, start).refitted
    change = greatest_change(study.given, refitted.unknown.entries, refitted.values)
    assert change.deviations < 60.0


@pytest.mark.parametrize("chi2", [0.8, 1.0, 3.0])
def test_values_far_from_the_file_cost_as_far_as_the_error_exceeds_the_noise(chi2):
    file = preset("bluerov2_heavy")
    unknown = free(file, ["linear_damping"])
    expected = about_file(file, ["linear_damping"], unknown)
    shots, count = 10, len(unknown.entries)
    gram = np.zeros((shots, count + 1, count + 1))
    gram[:, -1, -1] = 12.0 * chi2
    normal = Normal(gram, 12, np.ones((shots, 12)), np.zeros((shots, 0, count + 1)))
    far = unknown.starts[0] + 3.0 * unknown.scales
    plain = Model(unknown, far, cast(Any, None), normal)
    dearer = replace(plain, expected=expected).penalised.sum() - plain.penalised.sum()
    excess = max(plain.normal.chi2 - 1.0, 0.0)
    assert dearer == pytest.approx(excess * expected.cost(far / unknown.scales))
    assert (dearer > 0.0) == (chi2 > 1.0)


def test_where_no_fit_is_acceptable_further_candidates_are_fitted(monkeypatch):
    """A candidate with a small linear gain is fitted only if those with larger ones leave too much."""
    gains = {"payload": 100.0, "buoyancy_offset": 90.0, "ocean_current": 1.0}
    screening = SimpleNamespace(gains=gains, model=SimpleNamespace(vehicle=None))
    monkeypatch.setattr("hydro.core.diagnosis.search.shapes", lambda *_, **__: ())
    monkeypatch.setattr("hydro.core.diagnosis.search.refuted", lambda *_: False)
    track = SimpleNamespace(track=None)
    for left, fitted in ((1.0, ["payload", "buoyancy_offset"]), (50.0, list(gains))):
        normal = SimpleNamespace(chi2=left, residuals=1000.0)
        fit = SimpleNamespace(normal=normal, excess=1000.0 * (left - 1.0) + 10.0, vehicle=None)
        monkeypatch.setattr(Search, "joined", lambda *_, fit=fit: fit)
        search = Search(cast(Any, SimpleNamespace(log=track, sensors={})))
        assert list(search.quick_fits([], cast(Any, screening), gains, {}, silent)) == fitted
