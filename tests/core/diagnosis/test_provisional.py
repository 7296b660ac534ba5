"""The best candidate after the first fits: told once, early, and without a change of the result."""

from __future__ import annotations

from recordings import damped, moved, noisy

from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.pipeline import diagnose_log

HEAVY = {"name": "net_buoyancy", "dB": -8.0}


def test_the_best_candidate_is_told_once_and_early():
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
