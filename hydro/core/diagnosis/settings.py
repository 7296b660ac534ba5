"""Numbers that steer the search for missing effects, each with its unit and the reason for its value.

Diagnosis, explanation and discovery use them.  The hull-force model has its own numbers in `core.residual`.
"Noise" is the mean squared residual of sensor noise alone, and "floor" is that of the hull-force model on
held-out stretches of the recording that it was learnt from.  The "frozen table" is the result of
`benchmarks.judge` that the values were compared on.
"""

from __future__ import annotations

import math

import numpy as np

from hydro.core.residual import limits

# Shots, parts of a recording and resamples

MOST_SHOTS = 600
"""Maximum number of shots of one recording: it bounds the time of a fit."""
SHOTS = 96
"""Number of shots of a repeated fit, and of all fits above FAR_FROM_NOISE: four times as many change an error
by less than 1 %.  A first comparison of many candidates uses half of them, the search for a change twice as
many."""
LEAST_SHOTS = limits.LEAST_SHOTS
"""Minimum number of shots of a diagnosis."""
LEAST_SESSIONS = 3
"""Minimum number of sessions for holding out whole sessions."""
FOLDS = 6
"""Maximum number of stretches of a recording, each held out of one fit, and minimum number of predictions."""
LEAST_INFORMATION = 1.0 / LEAST_SESSIONS
"""Minimum share of the information on an effect that remains when a part is held out, and of the shots in
other sessions when sessions are held out: that of one of the fewest sessions.  With less, the other data do
not determine the fit."""
RESAMPLES = 2000
"""Number of bootstrap resamples: a frequency of 2 % is known to 0.3 %."""
RESOLUTION = np.repeat([0.005, 0.001, 0.005, 0.002], 3)
"""Minimum standard deviation of position [m], attitude [rad], velocity [m/s] and rates [rad/s].  No sensor is
more accurate; a filtered log is only smoother."""

# Fits

QUICK_STEPS = 6
"""Iterations of a candidate's first fit: enough to rank candidates.  A fit that starts close to its result
has half as many."""
STEP_GAIN = 0.3
"""Minimum reduction of the cost by one step of a fit, in residuals: a smaller one does not affect names."""
STEP_SHARE = 1e-3
"""Minimum reduction of the cost by one step, as a share of it: a poor model never converges fully."""
SMALL_STEP = 0.01
"""Small change: a trial force as a share of the weight, the resolution of thresholds in scales, and the size
in scales at or below which an effect counts as absent."""
SUSPECT_SPREAD = 2.0
"""Prior standard deviation of the parameters of a candidate effect, in their natural scales about 0."""
CORRELATED = 10.0
"""Number of correlated residuals of a shot that count as one where a model is wrong."""
FAR_FROM_PRIOR = limits.WITHIN
"""Distance beyond which a value contradicts its prior, in standard deviations from the file's value, or in
half widths from the middle of the plausible range, whose ends are uncertain by about that much."""

# Mean squared residuals

RIGHT = limits.RIGHT
"""Maximum residual of a model that may be right, in units of the noise or in floors: then likelihood names
effects.  A fit whose cost on other data exceeds its own by this ratio is repeated or dropped."""
FIT = limits.FIT
"""Maximum residual of an acceptable fit, in units of the noise or in floors.  Above it, candidates of a
change are chosen on the first part of each shot, and fits that have not converged continue.  A fit is not
continued where its error exceeds the best by this ratio."""
FAR_FROM_NOISE = 1000.0
"""Residual above which SHOTS shots carry the information of all, in units of the noise."""

# Candidates of one round

CONTENDERS = 5
"""Number of candidates that are always fitted or tested in one round, and half the maximum number of fits of
a round where none is right, or of terms that are tested on held-out data: it bounds the time."""
CLOSEST = (CONTENDERS + 1) // 2
"""Number of the best candidates that are fitted to convergence or reported: the better half of CONTENDERS."""
MOST_FINDINGS = 4
"""Maximum number of effects of one search: it bounds the time.  In the frozen table only two searches of
imperfect hulls reach it, with a right name first and wrong ones after it."""

# Size of a finding

MATERIAL = 0.05
"""Minimum share of an error, of the noise or of a floor that is worth a finding, a term or a further search.
So the error of the hull model gives a mean lead of MATERIAL floors by chance, and the formulas of earlier
changes one of MATERIAL for each floor that they removed."""
NEGLIGIBLE = 0.02
"""Share that does not matter, of an error or of the resamples: a smaller rise is no loss, a smaller fall no
gain, a term that explains less is not kept, and a rival that wins less often is not listed.  So each
component costs it when effects are compared: the hull's error is alike on all stretches, so held-out data
alone do not penalise components that follow it.  A cost of 0.004 adds a wrong statement."""
FURTHER = 0.2
"""Minimum share of the present error that a further finding explains, and that findings explain on average
for a search to continue: 0.15 adds two wrong, unconfirmed names in the frozen table."""
ABSORBED = 0.3
"""Share of an error of the hull model that an unrelated effect may absorb: mean lead by chance for each floor
of remaining residual beyond one, and penalty, in floors, of an effect that absorbs all error of a hull
(`absorbs`).  As the lead, it makes a confident wrong name of an independent simulator a suspect; without the
penalty, the frozen table has a second wrong statement."""
VISIBLE = 0.005
"""Minimum share of the whole squared error, noise included, of an effect or of a component.  A smaller gain
is invisible in a replay.  With 0.012 a thruster at 60 % in a Stonefish log is estimated at 68 %."""
CHANGED = 0.10
"""Minimum share of the held-out squared residual that a change removes, and mean relative lead by chance of a
name by held-out data: 0.05 adds two wrong, unconfirmed names in the frozen table, 0.15 loses a right
one."""
ALMOST_ALL = 0.9
"""Share that counts as almost all: of the error, for names by likelihood above RIGHT other than hull laws
alone; of the shots that stay finite; of the cost that a refit to the hull forces leaves when it has
converged."""
DISTINCT = 4.0
"""Distance from which two models differ, in standard errors: a general effect from its special case, a
candidate on few shots from the best, and an effect from steady wrenches under feedback."""
ALPHA = 0.01
"""Probability of a false alarm in one round, over all effects at once."""
NEARLY_EQUAL = 0.7
"""Ratio from which two shares or scores count as nearly equal; the likelier effect or term is then first."""
SIMILAR = 0.5
"""Ratio from which two shares, scores or gains count as of similar size."""
SIMILAR_CURVED = 0.1
"""The same ratio for the linear gain of a nonlinear effect, which shows only a part of what it explains."""
LEAST_EVIDENCE = 10.0
"""Log evidence that gaps of the hull-force library give by chance: smaller evidence does not rank the names,
that of a hull law counts only beyond it, and leads are compared with it."""

# Confidence

SURE = 0.9
"""Minimum confidence of a confirmed name: one in ten may be wrong."""
LIKELY = 0.6
"""Minimum confidence of a name that answers call likely; below it, it is possible."""
MOST_STATED = 0.98
"""Greatest confidence in an answer, which then says "more than 98 %".  Of 357 names with a confidence of
1.000, 356 are right (docs/scoreboard.md): the 95 % interval of their share begins at 98.4 %."""
DOUBTFUL = 0.5
"""Maximum confidence of a name that may stand for another effect: physics excludes its values, or it is named
by transfer although another effect is first or the file has it already.  Also the confidence from which
`explain` tries unconfirmed effects where none is confirmed: held-out data decide which stay."""
RIGHT_ABOVE = 102.0 / 118.0
"""Share of names by likelihood that were right where a model is not: above 1.35 times the noise, 102 of 118
(seeds 80000 to 84059).  Hull laws, now limited to DOUBTFUL, were among them.  It applies above RIGHT, and
above 1 + FURTHER times the noise if a further effect is significant: of the statements of all kept
studies, 587 of 588 were right below that, and 6 of 12 between that and RIGHT (`docs/adr/0070`)."""
STEADY_SECONDS = 20.0
"""Time over which a disturbance is taken as constant under feedback [s]."""

# Steps of an explanation

MOST_STEPS = 6
"""Maximum number of steps of an explanation, and of terms of a formula: it bounds the time."""
AXIS_LEVEL = math.erfc(limits.WITHIN / math.sqrt(2.0))
"""Probability that any axis is called worse by chance (Holm 1979 over the measured axes), that of an error
beyond two standard deviations: 0.046."""
