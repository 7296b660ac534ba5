"""What matters of what a search finds, and when it goes on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.diagnosis import by_likelihood
from hydro.core.diagnosis.baseline import Baseline, Outcome
from hydro.core.diagnosis.by_likelihood import searched
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.search import Search
from hydro.core.diagnosis.settings import FAR_FROM_NOISE, FURTHER, MATERIAL, SHOTS, VISIBLE
from hydro.core.progress import silent
from hydro.core.recording.shots import kept_evenly

RESIDUALS = 10_000.0


def leaving(excess: float) -> Model:
    """A model that leaves so much squared residual beyond the noise."""
    normal = SimpleNamespace(residuals=RESIDUALS, cost=RESIDUALS + excess)
    return cast(Model, SimpleNamespace(excess=excess, normal=normal))


def begun_from(excess: float) -> Baseline:
    """A search that starts where the file's own effects leave so much."""
    return Baseline(*[cast(Any, None)] * 5, leaving(excess), {})


@given(st.floats(1.0, 1e6), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_a_larger_gain_stays_material(first: float, left: float, part: float):
    """More of the same residual explained is never less of a finding, and what cannot be seen is none."""
    baseline, before = begun_from(first), leaving(left * first)
    gain = part * before.excess
    if baseline.material(gain, before):
        assert baseline.material(min(gain * 1.5, before.excess), before)
        assert gain >= VISIBLE * RESIDUALS


@pytest.mark.parametrize("shots", [600, 48])
def test_a_fit_to_some_of_the_shots_explains_as_much_as_one_to_all(shots: int):
    """A pair of effects is fitted to a part of the shots where the residual is far above the noise."""

    def over(count: int, chi2: float) -> Model:
        normal = SimpleNamespace(residuals=100.0 * count, cost=chi2 * 100.0 * count)
        return cast(
            Model, SimpleNamespace(costs=np.zeros(count), normal=normal, excess=(chi2 - 1.0) * 100.0 * count)
        )

    baseline = Baseline(*[cast(Any, None)] * 5, over(600, 101.0), {})
    assert baseline.explained(over(shots, 101.0)) == pytest.approx(0.0)
    assert baseline.explained(over(shots, 51.0)) == pytest.approx(0.5)


def test_a_significant_gain_is_material_if_it_is_a_large_share_of_the_present_residual():
    """A third effect is not passed over because the first one was a thousand times the noise."""
    baseline, before = begun_from(1000 * RESIDUALS), leaving(0.13 * RESIDUALS)
    plain = FURTHER * before.excess
    assert plain < MATERIAL * baseline.refitted.excess
    assert baseline.material(1.01 * plain, before)
    assert not baseline.material(0.9 * plain, before)


@pytest.mark.parametrize(("chi2", "shots", "left"), [(2e3, 300, SHOTS), (2e3, 148, 148), (50.0, 300, 300)])
def test_only_a_part_of_the_shots_is_used_far_from_the_noise(chi2: float, shots: int, left: int):
    """Both models and the problem keep the same of them; a recording near the noise keeps all."""
    costs = np.arange(shots, dtype=float)

    def some(most: int) -> Any:
        kept = SimpleNamespace(costs=costs[kept_evenly(shots, most)], vehicle=None)
        kept.coarsened = lambda vehicle: kept
        return kept

    model = cast(Any, SimpleNamespace(costs=costs, normal=SimpleNamespace(chi2=chi2), some=some))
    problem = cast(Any, SimpleNamespace(some=some))
    baseline = Baseline(cast(Any, None), (), cast(Any, None), problem, model, model, {})
    thinned = baseline.thinned()
    assert (thinned is baseline) == (left == shots)
    assert len(thinned.refitted.costs) == left
    if thinned is not baseline:
        for one in (thinned.given, thinned.refitted):
            np.testing.assert_array_equal(one.costs, cast(Any, thinned.problem).costs)


FIRST, RESUMED, FILED = "first", "resumed", "filed"


@pytest.mark.parametrize(
    ("left", "absurd", "filed", "order", "answer"),
    [
        (1.0, True, 1.0, [FIRST], FIRST),  # it reaches the noise
        (1.9, False, 1.0, [FIRST], FIRST),  # it fits
        (1.9, True, 1.0, [FIRST, FILED], FILED),  # it fits with absurd values, and the other better
        (1.8, True, 1.9, [FIRST, FILED], FIRST),  # the other is no better
        (50.0, False, 1.0, [FIRST, FILED], FILED),  # it does not fit, and the other does
        (2 * FAR_FROM_NOISE, False, 1.0, [FIRST, FILED], FILED),
        (2 * FAR_FROM_NOISE, False, 50.0, [FIRST, FILED, RESUMED], RESUMED),  # it had waited
        (50.0, False, 50.0, [FIRST, FILED], FIRST),  # it had not
    ],
)
def test_far_from_the_noise_the_search_starts_from_the_file_before_it_adds_a_second_effect(
    monkeypatch, left: float, absurd: bool, filed: float, order: list[str], answer: str
):
    asked: list[str] = []

    def grow(search: Search, progress: object, start: Any = None, other: Any = None, far: float = np.inf):
        asked.append(FILED if search.from_file else RESUMED if start else FIRST)
        assert far == (FAR_FROM_NOISE if asked[-1] == FIRST else np.inf)
        model = leaving(1.0 - FURTHER)
        model.normal.chi2 = filed if asked[-1] == FILED else left
        model.penalised = np.array([model.normal.chi2])
        return SimpleNamespace(model=model, found=("payload",), said=asked[-1])

    monkeypatch.setattr(Search, "grow", grow)
    monkeypatch.setattr(Search, "explains_little", lambda *_: False)
    monkeypatch.setattr(by_likelihood, "is_absurd", lambda *_: absurd)
    search, outcome = searched(begun_from(1.0), silent)
    assert (asked, cast(Any, outcome).said, search.from_file) == (order, answer, answer == FILED)


@pytest.mark.parametrize(("effect", "fitted"), [("thruster_deadband", True), ("ocean_current", False)])
def test_a_nonlinear_effect_between_two_grid_shapes_is_fitted(effect: str, fitted: bool):
    """A dead band between two widths of the grid is fitted, though neither width alone explains enough."""
    baseline, before = begun_from(0.03 * RESIDUALS), leaving(0.03 * RESIDUALS)
    screening = cast(Any, SimpleNamespace(gains={effect: 0.5 * VISIBLE * RESIDUALS}))
    assert Search(baseline).telling(screening, before) is fitted


@pytest.mark.parametrize(
    ("kept", "goes_on"), [(["payload"], False), (["buoyancy_offset"], True), ([], False)]
)
def test_a_search_continues_only_after_an_effect_was_replaced(monkeypatch, kept, goes_on):
    """A swap leaves less, of which more can be told; and what then joins is reconsidered with the others."""

    def outcome(effects: list[str]) -> Outcome:
        return cast(Outcome, SimpleNamespace(effects=effects, found=tuple(effects)))

    asked: list[list[str]] = []

    def reconsider(search: Search, given: Outcome, progress: object) -> Outcome:
        asked.append(given.effects)
        return outcome(kept) if len(asked) == 1 else given

    def grow(search: Search, progress: object, start: Outcome) -> Outcome:
        return outcome([*start.effects, "thruster_inflow"])

    monkeypatch.setattr(Search, "reconsider", reconsider)
    monkeypatch.setattr(Search, "grow", grow)
    settled = Search(begun_from(1.0)).settle(outcome(["payload"]), silent)
    assert settled.effects == [*kept, "thruster_inflow"] if goes_on else settled.effects == kept
    assert asked == [["payload"], [*kept, "thruster_inflow"]] if goes_on else asked == [["payload"]]
