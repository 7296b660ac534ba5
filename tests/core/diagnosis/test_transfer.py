"""Left-out errors against ridge regressions that were never shown them, and what a score is worth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import msgspec
import numpy as np
import polars as pl
import pytest
from recordings import damped, moved, noisy
from scipy.spatial.transform import Rotation

from hydro.core.diagnosis.baseline import Baseline
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.settings import LEAST_EVIDENCE, LEAST_INFORMATION
from hydro.core.diagnosis.transfer import Rival, Survey, left_out, one_change, ranked, weighed
from hydro.core.effects import CATALOGUE
from hydro.core.effects.hull_laws import DRAG, has_drag
from hydro.core.evaluation.replay_error import BEYOND
from hydro.core.evaluation.velocity_errors import squares_ahead, squares_at_rest
from hydro.core.identification.levenberg_marquardt import Prior
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.multiple_shooting import predict, prepare
from hydro.core.prediction.normal_equations import Normal
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.vehicle.description import Vehicle
from hydro.io.files import bundled
from hydro.io.vehicle import read

CROSS_AXIS = "cross_axis_drag"
HEAVY = {"name": "net_buoyancy", "dB": -8.0}
SHOTS, ROWS, COLUMNS = 40, 30, 3
FOLD = np.repeat(np.arange(4), 10)


@dataclass(frozen=True)
class Scaled:
    """Entries of which only the scales matter."""

    scales: np.ndarray


def drawn(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((SHOTS, ROWS, COLUMNS))
    return columns, columns @ [0.5, -0.3, 0.2] + rng.standard_normal((SHOTS, ROWS))


def ridge(columns: np.ndarray, error: np.ndarray, prior: Prior) -> np.ndarray:
    flat = columns.reshape(-1, COLUMNS)
    matrix = flat.T @ flat + np.diag(prior.information)
    return np.linalg.solve(matrix, flat.T @ error.ravel() + prior.information * prior.centre)


def model(columns: np.ndarray, error: np.ndarray, prior: Prior, scales: np.ndarray) -> Model:
    """At its ridge estimate; the entries' values are in their own units."""
    found = ridge(columns, error, prior)
    both = np.concatenate([columns, (error - columns @ found)[..., None]], axis=-1)
    gram = both.transpose(0, 2, 1) @ both
    normal = Normal(gram, ROWS, gram[:, -1:, -1], np.zeros((SHOTS, 0, COLUMNS + 1)))
    return Model(Scaled(scales), found * scales, None, normal)


@pytest.mark.parametrize("weight", [1e-3, 200.0])
def test_left_out_costs_equal_ridge_regressions_without_the_fold(weight):
    columns, error = drawn()
    prior = Prior(np.array([1.0, 0.0, -1.0]), weight * np.array([1.0, 2.0, 3.0]))
    fitted = model(columns, error, prior, np.array([1.0, 10.0, 0.1]))
    found = left_out(fitted, lambda unknown: prior, FOLD)
    for number in range(4):
        out = number == FOLD
        known = ridge(columns[~out], error[~out], prior)
        expected = ((error[out] - columns[out] @ known) ** 2).sum(axis=1)
        np.testing.assert_allclose(found[out], expected, rtol=1e-9)


def test_the_prediction_error_is_the_weighted_root_mean_square_of_velocities():
    shots = make_shots(recording(damped(), moved(damped(), rows=250)), sigma=np.ones(12))
    weights = np.array([0.5, 0.1, 0.1, 0.1, 0.1, 0.1])
    buoyant = damped({"name": "net_buoyancy", "dB": 30.0})
    assert squares_ahead(damped(), shots).error(weights) < 0.1 * squares_ahead(buoyant, shots).error(weights)
    motion = predict(prepare(candidate(buoyant), shots), shots)
    expected = np.sqrt(weights @ ((motion - shots.measured)[..., 7:] ** 2).mean(axis=(0, 1)))
    assert squares_ahead(buoyant, shots).error(weights) == pytest.approx(expected)
    driven = damped(
        {"name": "formula", "forces": ["X u"], "force": [1e5], "moments": ["N r"], "moment": [1e5]}
    )
    assert squares_ahead(driven, shots).error(weights) <= np.sqrt(weights @ BEYOND[6:] ** 2)
    assert squares_ahead(driven, shots).error(weights) > 10.0


def test_a_fold_with_most_of_the_information_does_not_count():
    columns, error = drawn()
    columns[FOLD == 2, :, 0] *= 20.0
    prior = Prior(np.zeros(COLUMNS), np.full(COLUMNS, 1e-3))
    fitted = model(columns, error, prior, np.ones(COLUMNS))
    shown = (columns[..., 0] ** 2).sum(axis=1)
    assert shown[FOLD != 2].sum() < LEAST_INFORMATION * shown.sum()
    found = left_out(fitted, lambda unknown: prior, FOLD, new=[0])
    assert np.isnan(found[FOLD == 2]).all()
    assert np.isfinite(found[FOLD != 2]).all()


def test_the_absorbed_hull_error_is_subtracted_from_the_score():
    absorbing = [name for name, one in CATALOGUE.items() if one.identification.absorbs > 0.0]
    assert absorbing
    for name in absorbing:
        share = CATALOGUE[name].identification.absorbs
        assert weighed(Rival(name, False, None, share, 1.0)).score == pytest.approx(0.0)
        assert weighed(Rival(name, False, None, 1.0, 1.0)).score == pytest.approx(1.0)
        assert Rival(name, False, None, share, 1.0).score == pytest.approx(share)
    other = next(name for name in CATALOGUE if name not in absorbing)
    assert weighed(Rival(other, False, None, 0.4, 0.2)).score == pytest.approx(0.2)


def test_evidence_counts_only_beyond_the_absorbed_hull_error():
    absorbing = weighed(Rival(CROSS_AXIS, False, None, 0.5, 0.5))
    assert absorbing.beyond == pytest.approx(absorbing.score / 0.5)
    assert weighed(Rival(CROSS_AXIS, False, None, -0.1, 0.2)).beyond == 0.0, "it removes nothing elsewhere"
    assert weighed(Rival("ocean_current", False, None, 0.5, 0.4)).beyond == 1.0


def test_laws_of_the_hull_need_more_evidence_for_a_lead():
    def lead(name: str) -> float:
        return Rival(name, False, None, 0.5, 0.5, evidence=50.0).lead

    assert lead("ocean_current") == lead("thruster_lag") == lead("payload") == 50.0
    assert lead("linear_damping") == lead("body_lift") == lead("added_mass") == 50.0 - LEAST_EVIDENCE


def test_the_worth_of_a_rival_is_its_share_of_the_best_evidence():
    best, other = (Rival("payload", False, None, 0.2, 0.2, evidence=e) for e in (80.0, 20.0))
    both = (best, other)
    surveyed = Survey(cast(Any, None), both, by_evidence=True, leading=both)
    assert (surveyed.worth(best), surveyed.worth(other)) == (1.0, 0.25)
    assert Survey(cast(Any, None), both, False, both).worth(other) == pytest.approx(0.2)


@dataclass(frozen=True)
class Sized:
    """A rival of which the score and the number of entries are given."""

    effect: str
    score: float
    entries: int


def test_of_nearly_equal_effects_the_one_with_fewest_entries_is_first():
    """A gain for each of eight thrusters bends to a curve of one number, and to whatever else is wrong."""
    gains, curve = Sized("thruster_gain", 0.32, 8), Sized("thruster_curve", 0.31, 1)
    assert ranked([gains, curve])[0] is curve
    far = Sized("thruster_gain", 0.5, 8)
    assert ranked([far, curve])[0] is far


def stating(vehicle: Vehicle, *names: str) -> Vehicle:
    """The vehicle with a standard error beside the values of some of its effects."""
    tables = (
        table | {"standard_error": {"diagonal": [0.1 * value for value in table["diagonal"]]}}
        if table["name"] in names
        else table
        for table in vehicle.effect
    )
    return msgspec.structs.replace(vehicle, effect=tuple(tables))


@pytest.mark.parametrize(
    ("known", "free"),
    [((), True), (("linear_damping",), True), (("linear_damping", "quadratic_damping"), False)],
    ids=["nothing", "a part", "all"],
)
def test_values_with_standard_errors_in_the_file_are_kept(known, free):
    """They were fitted to the hull without the change; free, they would take the change up."""
    file = stating(read(bundled("vehicles") / "auv151.toml")[0], *known)
    own = ("linear_damping", "quadratic_damping")
    baseline = Baseline(file, own, *[cast(Any, None)] * 4, {})
    assert one_change(baseline).effects == (own if free else ())
    later = replace(baseline, vehicle=stating(file, *own), file=file)
    assert one_change(later).effects == one_change(baseline).effects, "what this recording gave holds nothing"


def test_drag_comes_before_its_lookalikes_if_the_file_has_none():
    drag, loss = Sized(CROSS_AXIS, 0.20, 15), Sized("thruster_inflow", 0.205, 1)
    assert ranked([drag, loss])[0] is loss
    assert ranked([drag, loss], DRAG)[0] is drag
    far = Sized("ocean_current", 0.9, 3)
    assert ranked([drag, loss, far], DRAG)[0] is far, "what removes far more is no matter of drag"
    assert ranked([], DRAG) == ()
    assert CROSS_AXIS in DRAG


def test_a_file_with_linear_damping_alone_has_no_drag():
    file = read(bundled("stonefish") / "vehicle.toml")[0]
    assert not has_drag(file)
    linear = msgspec.structs.replace(file, effect=({"name": "linear_damping", "diagonal": [1.0] * 6},))
    assert not has_drag(linear)
    both = msgspec.structs.replace(file, effect=({"name": "quadratic_damping", "diagonal": [1.0] * 6},))
    assert has_drag(both)


def test_without_velocity_samples_the_covered_distance_is_compared():
    """Depth alone: heave counts, by the change of depth over five seconds; surge does not."""
    raw = noisy(moved(damped(HEAVY), rows=3000), 1)
    blind = raw.with_columns(pl.lit(None, pl.Float64).alias(name) for name in ("x", "y", "u", "v", "w"))
    shots = make_shots(recording(damped(), blind), seconds=5.0)
    rest = squares_at_rest(shots)
    away = shots.measured[..., 2] - shots.first[:, None, 2]
    down = Rotation.from_quat(shots.first[:, [4, 5, 6, 3]]).inv().apply([0.0, 0.0, 1.0])[:, 2]
    np.testing.assert_allclose(rest.sums[:, 2], ((away * down[:, None] / 5.0) ** 2).sum(axis=1), rtol=1e-6)
    assert rest.counts[:, :3].sum(axis=0).tolist() == [0.0, 0.0, shots.measured[..., 2].size]
    light, heavy = (squares_ahead(one, shots).mean[2] for one in (damped(), damped(HEAVY)))
    assert heavy < 0.8 * light  # begun without a velocity
