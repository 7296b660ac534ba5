"""Numbers that the hull-force model shares with the diagnosis (`diagnosis.settings`)."""

from __future__ import annotations

LEAST_SHOTS = 16
"""Minimum number of shots of a diagnosis.  A hull-force model, which is also tested on held-out data, needs
twice as many."""
RIGHT = 2.0
"""Ratio up to which two squared residuals may be equal: of a model to the noise, of other data to those of a
fit, or of a simulated response to one of first order.  The last is 0.7 to 1.0 for three files that predict
two seconds well, and 2.5 for a torpedo whose file errs by 0.7 m/s in surge after two seconds."""
FIT = 3.0
"""Maximum reduced chi-square of an acceptable prediction."""
WITHIN = 2.0
"""Number of standard deviations within which 95 % of normal errors lie."""
