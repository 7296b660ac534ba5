"""In words: how well a vehicle file predicts a recording before and after findings are added to it."""

from __future__ import annotations

from hydro.core.diagnosis.findings import Prediction


def prediction(known: Prediction) -> str:
    """Return one sentence with the errors before and after, and what noise alone leaves."""
    now = f"Predictions {known.horizon:g} s ahead are off by {known.given:.3g} m/s"
    noise = f"noise alone: {known.floor:.2g}"
    if known.added == known.given:
        return f"{now} ({noise})."
    after = f"{known.added:.3g} m/s with what is stated below added ({noise})"
    if known.falls:
        return f"{now}; {after}."
    return f"{now}; {after}: adding it does not help, and hydro add refuses it."
