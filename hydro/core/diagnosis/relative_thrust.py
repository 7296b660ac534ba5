"""Rates of turn show the thrust of horizontal thrusters only as a multiple of the file's inertia.

A moment N and an inertia I enter a rate of turn by N / I alone.  Where no sensor shows surge or sway, weak
thrusters and an inertia that is too small in the file predict the same motion.
"""

from __future__ import annotations

from dataclasses import replace

from hydro.core.diagnosis.findings import FANCIFUL, Finding
from hydro.core.effects.actuator import THRUSTER_GAIN
from hydro.core.recording.arrays import HORIZONTAL, Recording

STATED = ("missing", "cannot_tell_apart")
WORDS = (
    "rates alone show thrust only as a multiple of the file's inertia, which may be too small: record "
    "a velocity or a position, or measure the inertia"
)


def beside_inertia(finding: Finding, record: Recording) -> Finding:
    """The finding, only suspected where it is a gain of thrusters that a wrong inertia predicts as well."""
    if finding.verdict not in STATED or finding.effect != THRUSTER_GAIN.name or record.shows(HORIZONTAL):
        return finding
    sure = min(finding.confidence, FANCIFUL)
    return replace(finding, verdict="suspect", confidence=sure, advice=f"{WORDS}; {finding.advice}")
