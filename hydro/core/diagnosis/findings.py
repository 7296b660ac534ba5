"""What a diagnosis says: its verdicts, as records and as a table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import polars as pl
import polars.selectors as cs

from hydro.core.vehicle.description import Vehicle

Verdict = Literal[
    "log_fault",
    "missing",
    "retune",
    "cannot_tell_apart",
    "not_excited",
    "none_of_the_known",
    "nothing_missing",
]


@dataclass(frozen=True)
class Finding:
    """One line of a diagnosis.

    Attributes:
        verdict: What is the matter.
        effect: The effect that explains it best; empty where none is meant.
        members: All effects that it may be; of `log_fault`, the columns.
        share: Part of the error beyond the noise that it explains, with
        low: the lower and
        high: the upper end of its 95 % interval; NaN where there is none.
        confidence: Part of the resampled recordings in which this effect is the best; NaN where
            none is meant.
        p_value: That chance alone would show as much; NaN where nothing was tested.
        parameters: Fitted values of the effect's table.
        standard_errors: Theirs.
        excited: Whether the recording could have shown it.
        advice: What to do.
    """

    verdict: Verdict
    effect: str = ""
    members: tuple[str, ...] = ()
    share: float = math.nan
    low: float = math.nan
    high: float = math.nan
    confidence: float = math.nan
    p_value: float = math.nan
    parameters: Mapping[str, Any] = field(default_factory=dict)
    standard_errors: Mapping[str, Any] = field(default_factory=dict)
    excited: bool = True
    advice: str = ""


@dataclass(frozen=True)
class Diagnosis:
    """What is missing in a vehicle file.

    Attributes:
        findings: The most telling first.
        vehicle: The vehicle with its own effects fitted anew and what was found, all fitted together.
        chi2: Mean squared residual in units of the noise of the file as given, with its own effects fitted
            anew, and with what was found; 1 where nothing but noise is left.
    """

    findings: tuple[Finding, ...]
    vehicle: Vehicle
    chi2: tuple[float, float, float]

    def frame(self) -> pl.DataFrame:
        """The diagnosis table, one row per finding; effect tables as inline TOML."""
        rows = [
            {
                "rank": number,
                "verdict": one.verdict,
                "effect": one.effect,
                "members": list(one.members),
                "share_of_error_explained": one.share,
                "share_low": one.low,
                "share_high": one.high,
                "confidence": one.confidence,
                "p_value": one.p_value,
                "parameters": inline(one.parameters),
                "standard_errors": inline(one.standard_errors),
                "excited": one.excited,
                "advice": one.advice,
            }
            for number, one in enumerate(self.findings, 1)
        ]
        return pl.DataFrame(rows, infer_schema_length=None).with_columns(cs.float().fill_nan(None))


def inline(table: Mapping[str, Any]) -> str:
    """An effect's table as inline TOML: `{ v_N = 0.2, v_E = -0.15 }`."""
    if not table:
        return ""
    return "{ " + ", ".join(f"{key} = {_value(value)}" for key, value in table.items()) + " }"


def _value(value: Any) -> str:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(inner) for inner in value)}]"
    return repr(float(value))
