"""Best candidate of a search so far, which a long diagnosis reports before its answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from hydro.core.diagnosis.confidence import by_likelihood_confidence, selection_frequency
from hydro.core.diagnosis.model import Model, Screening, leader
from hydro.core.diagnosis.search import Search
from hydro.core.progress import Progress


@dataclass(frozen=True)
class Provisional:
    """Best candidate after the first fits.

    Attributes:
        effect: Its name.
        confidence: Probability that the name is right, by these fits alone.
        share: Share of the error that it explains: of the error beyond the noise, or of the held-out error
            where a recording from before a change is given.
    """

    effect: str
    confidence: float
    share: float


Told = Callable[[Provisional], None]
"""Called once, with the best candidate after the first fits."""


@dataclass(frozen=True)
class ReportingSearch(Search):
    """Search that reports its best candidate as soon as the first candidates are fitted.

    Attributes:
        told: Receives the report; None for a search that reports nothing.
        reported: Holds the report once it was made: each search of a diagnosis shares it.
    """

    told: Told | None = None
    reported: list[Provisional] = field(default_factory=list, repr=False)

    def quick_fits(
        self,
        chosen: Sequence[str],
        screening: Screening,
        gains: Mapping[str, float],
        known: Mapping[str, Model],
        progress: Progress,
    ) -> dict[str, Model]:
        """Fit the candidates as any search does, and report the best of the first ones."""
        fits = super().quick_fits(chosen, screening, gains, known, progress)
        best = leader(fits)
        if self.told is not None and best is not None and not self.reported:
            before, model = screening.model, fits[best]
            frequency = selection_frequency(fits, best)[best]
            confidence = by_likelihood_confidence(frequency, model.normal.chi2)
            share = (before.normal.cost - model.normal.cost) / max(before.excess, 1e-9)
            self.reported.append(Provisional(best, confidence, float(min(max(share, 0.0), 1.0))))
            self.told(self.reported[0])
        return fits
