"""When a search is done, by how much of the error what it found explains."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

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
    found = [cast(Any, SimpleNamespace(effect="net_buoyancy"))]
    assert Search(explaining(share), from_file=True).explains_little(leaving(20.0), found) is little
    assert not Search(explaining(share, sure=True), from_file=True).explains_little(leaving(20.0), found)
