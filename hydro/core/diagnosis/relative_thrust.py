"""Rates of turn show the thrust of horizontal thrusters only relative to the inertia in the file.

A moment N and an inertia I act on a rate of turn through N / I alone.  Without a sensor of surge or sway,
weak thrusters and too small an inertia in the file predict the same motion.
"""

from __future__ import annotations

from dataclasses import replace

from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.settings import DOUBTFUL
from hydro.core.effects.actuator import THRUSTER_GAIN
from hydro.core.recording.arrays import HORIZONTAL, Recording

DOUBTED = ("missing", "cannot_tell_apart", "suspect")
"""Verdicts that become or stay unconfirmed."""
WORDS = (
    "rates alone show thrust only relative to the inertia in the file, which may be too small: record a "
    "velocity or a position, or measure the inertia"
)


def doubted_gain(finding: Finding, record: Recording) -> Finding:
    """Make a finding of thruster gains unconfirmed where a wrong inertia predicts the same motion.

    Its confidence is then at most DOUBTFUL.

    Args:
        finding: Any finding; only confirmed and unconfirmed thruster gains are changed.
        record: Recording; without horizontal velocity or position a wrong inertia predicts the same.
    """
    if finding.verdict not in DOUBTED or finding.effect != THRUSTER_GAIN.name or record.shows(HORIZONTAL):
        return finding
    sure = min(finding.confidence, DOUBTFUL)
    return replace(finding, verdict="suspect", confidence=sure, advice=f"{WORDS}; {finding.advice}")
