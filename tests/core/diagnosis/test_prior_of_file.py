"""Fits of a search stay near the values of the file, as far as the recording allows."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.hidden_effects.vehicles import preset
from benchmarks.judge.studies import LISTS
from hydro.core.diagnosis.baseline import refit, stable_start
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.identification.levenberg_marquardt import PRIOR
from hydro.core.identification.prior import KNOWN, about_file, greatest_change
from hydro.core.prediction.parameters import free


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
