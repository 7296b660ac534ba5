"""Best candidate of a search so far, which a long diagnosis reports before its answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from hydro.core.diagnosis.confidence import by_likelihood_confidence, selection_frequency
from hydro.core.diagnosis.model import Model, leader
from hydro.core.diagnosis.settings import RIGHT


@dataclass(frozen=True)
class Provisional:
    """Best candidate after the first fits.

    Attributes:
        effect: Name of the effect.
        confidence: Probability that the name is right, by these fits alone.
        share: Share of the error that the effect explains: of the error beyond the noise, or of the held-out
            error where a recording from before a change is given.
    """

    effect: str
    confidence: float
    share: float

    @classmethod
    def of(cls, fits: Mapping[str, Model], before: Model) -> Provisional | None:
        """Return the best of some fits; None without fits."""
        best = leader(fits)
        if best is None:
            return None
        model, frequency = fits[best], selection_frequency(fits, best)[best]
        share = (before.normal.cost - model.normal.cost) / max(before.excess, 1e-9)
        sure = by_likelihood_confidence(frequency, model.normal.chi2 <= RIGHT)
        return cls(best, sure, float(min(max(share, 0.0), 1.0)))


Told = Callable[[Provisional], None]
"""Called once, with the best candidate after the first fits."""
