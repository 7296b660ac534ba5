"""The best candidate after the first fits: told once, early, and without a change of the result."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from recordings import damped, moved, noisy

from hydro.core.diagnosis import by_change
from hydro.core.diagnosis.contenders import Contender, Contest
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.pipeline import diagnose_log
from hydro.core.diagnosis.provisional import Provisional
from hydro.core.progress import silent

HEAVY = {"name": "net_buoyancy", "dB": -8.0}


def test_the_best_candidate_is_reported_once_and_early():
    raw = noisy(moved(damped(HEAVY), rows=1500), 1)
    told, shares = [], []
    found = diagnose_log(
        damped(),
        preprocess(damped(), raw),
        progress=lambda words, share: shares.append(share),
        provisional=lambda best: told.append((best, shares[-1])),
    )
    ((best, share),) = told
    assert best.effect == "net_buoyancy" == found.findings[0].effect
    assert 0.0 < best.confidence <= 1.0
    assert best.share > 0.8
    assert share < 0.3
    assert shares == sorted(shares), "the bar never goes back"
    assert max(shares[:-1]) < 1.0, "what is reported as done is followed by nothing"
    again = diagnose_log(damped(), preprocess(damped(), raw))
    assert again.frame().equals(found.frame())


def test_the_best_change_is_reported_after_the_first_fits(monkeypatch):
    one = cast(Any, SimpleNamespace(values=np.zeros(1)))
    fits = {
        name: Contender(name, one, np.full(20, left)) for name, left in (("payload", 1.0), ("tether", 3.0))
    }
    compared = SimpleNamespace(
        chi2=lambda model: 4.0, left_out=lambda normal: np.full(20, 4.0), floor=lambda model: 20.0
    )
    first = SimpleNamespace(normal=SimpleNamespace(of=lambda columns: None))

    def contend(contest, taken, progress, first_fits):
        first_fits(fits)
        return {}

    monkeypatch.setattr(Contest, "fits", contend)
    monkeypatch.setattr(by_change, "onset", lambda contest: None)
    told: list[Provisional] = []
    known = cast(Any, None)
    by_change.ByChange(known, cast(Any, compared), cast(Any, first), 4.0, told=told.append).select(silent)
    assert [(best.effect, best.share) for best in told] == [("payload", pytest.approx(0.75))]
    assert 0.9 < told[0].confidence <= 1.0
