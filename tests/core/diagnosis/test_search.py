"""When a search is done, by how much of the error what it found explains."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from hydro.core.diagnosis.baseline import Found, Grown
from hydro.core.diagnosis.by_likelihood import may_be_right
from hydro.core.diagnosis.model import Diverges
from hydro.core.diagnosis.search import Search


def explaining(share: float, sure: bool = False) -> Any:
    """A baseline of whose error any model explains so much."""
    return SimpleNamespace(explained=lambda model: share, sure=lambda name: sure)


def leaving(chi2: float) -> Any:
    return SimpleNamespace(normal=SimpleNamespace(chi2=chi2))


@pytest.mark.parametrize(
    ("share", "chi2", "wrong"), [(0.5, 20.0, True), (0.8, 20.0, True), (0.97, 20.0, False), (0.5, 1.0, False)]
)
def test_a_model_above_the_noise_is_wrong_unless_it_explains_almost_all(share, chi2, wrong):
    outcome = SimpleNamespace(model=leaving(chi2), found=("one",), last=SimpleNamespace(significant=False))
    assert Search(explaining(share)).wrong(cast(Any, outcome)) is wrong


@pytest.mark.parametrize(("share", "little"), [(0.5, True), (0.8, True), (0.97, False)])
def test_a_search_from_the_file_continues_only_if_its_first_effect_explains_almost_all(share, little):
    found = [cast(Any, SimpleNamespace(effect="net_buoyancy", ahead={}))]
    assert Search(explaining(share), from_file=True).explains_little(leaving(20.0), found) is little
    assert not Search(explaining(share, sure=True), from_file=True).explains_little(leaving(20.0), found)


def test_a_search_from_the_file_continues_if_its_first_two_effects_reach_the_noise():
    first = Found("thruster_gain", 0.0, {}, {"ocean_current": leaving(1.0)})
    search = Search(explaining(0.8), from_file=True)
    assert not search.explains_little(leaving(20.0), [first])
    assert search.explains_little(leaving(20.0), [replace(first, ahead={"payload": leaving(15.0)})])


def test_the_second_effect_of_a_look_ahead_competes_in_the_next_round(monkeypatch):
    """It is fitted to convergence together with the first.

    It is left out where that diverges, and where kinematics refutes it.
    """

    def converged(search: Search, quick: Any, before: Any, chosen: list[str]) -> Any:
        if quick is not leading:
            raise Diverges("the predicted motion diverges")
        assert before is model
        assert chosen == ["thruster_gain", "ocean_current"]
        return quick

    monkeypatch.setattr(Search, "converged", converged)
    leading, model = SimpleNamespace(vehicle=None), leaving(2.2)
    search = Search(cast(Any, SimpleNamespace(sensors={})))
    first = Found("thruster_gain", 0.0, {}, {"ocean_current": cast(Any, leading)})
    assert search.looked_ahead(Grown(model, (first,))) == {"ocean_current": leading}
    assert search.looked_ahead(Grown(model, (replace(first, ahead={"tether": leaving(9.0)}),))) == {}
    assert search.looked_ahead(Grown(model, ())) == {}
    monkeypatch.setattr("hydro.core.diagnosis.search.refuted", lambda *_: True)
    assert search.looked_ahead(Grown(model, (first,))) == {}


def fitted(chi2: float) -> Any:
    """A model of ten shots that leaves so many times the noise."""
    costs = np.full(10, chi2)
    return SimpleNamespace(normal=SimpleNamespace(chi2=chi2), costs=costs, penalised=costs)


@pytest.mark.parametrize(
    ("left", "current_and_drag", "first"),
    [(2.0, 1.0, "coupled_damping"), (2.0, 1.6, "thruster_gain"), (1.04, 1.0, "thruster_gain")],
)
def test_the_first_effect_is_the_one_that_a_second_completes_best(monkeypatch, left, current_and_drag, first):
    """The gains of all thrusters absorb most of a drag and a current: each alone explains less.

    Where the gains alone leave noise, no pairs are fitted.
    """
    columns = {"thruster_gain": [0, 1, 2], "coupled_damping": [3], "ocean_current": [4], "payload": [5]}
    gains = {("thruster_gain", "ocean_current"): 59.0, ("coupled_damping", "ocean_current"): 58.0}
    together = {
        ("thruster_gain", "ocean_current"): 1.5,
        ("coupled_damping", "ocean_current"): current_and_drag,
    }
    by_columns = {(*columns[a], *columns[b]): gain for (a, b), gain in gains.items()}
    screening = SimpleNamespace(
        model=fitted(10.0),
        own=range(0),
        ranked={name: (None, place) for name, place in columns.items()},
        evidence=SimpleNamespace(gain=lambda own, place: by_columns.get(tuple(place), 1.0)),
    )
    tried = list[tuple[str, ...]]()

    def joined(search: Search, chosen: Any, screening: Any, *names: str) -> Any:
        tried.append(names)
        return fitted(together.get(cast(Any, names), 5.0))

    monkeypatch.setattr(Search, "joined", joined)
    fits = {"thruster_gain": fitted(left), "coupled_damping": fitted(3.5)}
    found = Search(cast(Any, None)).with_second(cast(Any, screening), fits, "thruster_gain")
    assert found[0] == first
    assert list(found[1]) == (["ocean_current"] if left > 1.05 else [])
    assert (("coupled_damping", "ocean_current") in tried) is (left > 1.05)
    assert ("ocean_current", "payload") not in tried, "neither has been fitted alone"


@pytest.mark.parametrize(
    ("chi2", "significant", "right"),
    [(1.1, True, True), (1.3, True, False), (1.3, False, True), (2.1, False, False)],
)
def test_a_model_that_leaves_a_fifth_of_the_noise_is_right_only_if_nothing_more_is_significant(
    chi2, significant, right
):
    outcome = SimpleNamespace(model=leaving(chi2), last=SimpleNamespace(significant=significant))
    assert may_be_right(cast(Any, outcome)) is right
