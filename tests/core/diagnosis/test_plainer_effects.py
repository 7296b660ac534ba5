"""Effects that take the place of one that they are nearly as good as."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from hydro.core.diagnosis import search
from hydro.core.diagnosis.search import Search


def model(cost: float) -> Any:
    return SimpleNamespace(
        vehicle=SimpleNamespace(without=lambda _: None),
        problem=None,
        normal=SimpleNamespace(cost=cost, chi2=1.0),
    )


@pytest.mark.parametrize(
    ("costs", "kept"),
    [((500.0, 100.5), False), ((100.5, 500.0), False), ((500.0, 500.0), True), ((100.5, 100.5), False)],
)
def test_the_best_effect_is_dropped_if_a_simpler_one_fits_equally_well(monkeypatch, costs, kept):
    tables = [{"name": "first", "cost": costs[0]}, {"name": "second", "cost": costs[1]}]
    monkeypatch.setattr(search, "leader", lambda _: "best")
    monkeypatch.setattr(search, "plainer", lambda *_: tables)
    searching = SimpleNamespace(
        baseline=SimpleNamespace(vehicle=None), _fit=lambda vehicle, chosen, *_: model(chosen[-1]["cost"])
    )
    fits = {"best": model(100.0), "other": model(300.0)}
    found = Search.with_plainer(cast(Any, searching), fits, [])
    assert set(found) == {"other", "first", "second"} | ({"best"} if kept else set())
