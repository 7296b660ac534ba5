"""Other places of an effect of the file, from which a fit may find less."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from recordings import damped

from hydro.core.identification import initial_guess
from hydro.core.prediction.parameters import free


@pytest.mark.parametrize(("cost", "expected"), [(5.0, [0.3]), (1.5, [0.3]), (1.0, []), (0.5, [])])
def test_of_all_places_the_best_is_begun_from_where_it_promises_less_than_the_fit(
    monkeypatch, cost, expected
):
    places = [(1.0, np.array([0.3])), (2.0, np.array([0.2])), (9.0, np.array([0.02]))]
    monkeypatch.setattr(initial_guess, "_begun", lambda *_: places)
    unknown = free(damped({"name": "sensor_delay", "d": 0.1}), ["sensor_delay"])
    nothing = cast(Any, None)
    found = initial_guess.elsewhere(unknown, np.array([0.1]), nothing, nothing, cost)
    assert [values.tolist() for values in found] == ([expected] if expected else [])
