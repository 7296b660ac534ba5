"""In words: how well a vehicle file predicts a recording before and after findings are added to it."""

from __future__ import annotations

from hydro.core.diagnosis.findings import Prediction


def prediction(known: Prediction) -> str:
    """Return the errors before and after, and what noise alone leaves, a sentence each."""
    parts = [f"{known.horizon:g} s ahead, the file's predictions are off by {known.given:.3g} m/s."]
    if known.added != known.given:
        parts.append(
            f"With what is stated added they are off by {known.added:.3g} m/s, on stretches that it was not "
            "fitted to."
        )
        if not known.falls:
            parts.append("So adding it does not help, and hydro add refuses it.")
    if known.floor is not None:
        parts.append(f"Noise alone leaves {known.floor:.2g} m/s.")
    return " ".join(parts)
