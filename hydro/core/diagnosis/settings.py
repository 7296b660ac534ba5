"""Numbers that steer the search for missing effects, each with its unit and the reason for its value.

Diagnosis, explanation and discovery use them.  The hull-force model has its own numbers in `core.residual`.
"Noise" is the mean squared residual of sensor noise alone, and "floor" is that of the hull-force model on
held-out stretches of the recording that it was learnt from.
"""

from __future__ import annotations

import numpy as np

# Shots, parts of a recording and resamples

MOST_SHOTS = 600
"""Maximum number of shots of one recording: it bounds the time of a fit."""
SHOTS = 96
"""Number of shots of a repeated fit, and of all fits above FAR_FROM_NOISE: four times as many change an error
by less than 1 %."""
FEW_SHOTS = 48
"""Number of shots of a first comparison of many candidates: the closest are then fitted to more shots."""
LEAST_SHOTS = 16
"""Minimum number of shots of a diagnosis."""
SHORTEST_SHOT = 0.5
"""Length below which shots are not shortened to get LEAST_SHOTS of them [s]: 10 s of sinking suffice."""
LEAST_SESSIONS = 3
"""Minimum number of sessions for holding out whole sessions."""
FOLDS = 6
"""Maximum number of stretches of a recording, each held out of one fit, and minimum number of predictions."""
LEAST_INFORMATION = 1.0 / 3.0
"""Minimum share of the information on an effect that remains when a part is held out, and of the shots in
other sessions when sessions are held out: with less, the other data do not determine the fit."""
RESAMPLES = 2000
"""Number of bootstrap resamples: a frequency of 2 % is known to 0.3 %."""
TIED = 0.02
"""Minimum share of resamples that a rival wins to be listed with the best."""
RESOLUTION = np.repeat([0.005, 0.001, 0.005, 0.002], 3)
"""Minimum standard deviation of position [m], attitude [rad], velocity [m/s] and rates [rad/s].  No sensor is
more accurate; a filtered log is only smoother."""

# Fits

QUICK_STEPS = 6
"""Iterations of a candidate's first fit: enough to rank candidates."""
LONG_STEPS = 24
"""Iterations of a final fit where no model reaches the noise, and of fits that continue above TUMBLING."""
REFITS = 3
"""Maximum number of refits to the hull forces that act on the fitted vehicle, and iterations from a fit of
all shots to a fit without one part of them: both start close to their result."""
STEP_GAIN = 0.3
"""Minimum reduction of the cost by one step of a fit, in residuals: a smaller one does not affect names."""
STEP_SHARE = 1e-3
"""Minimum reduction of the cost by one step, as a share of it: a poor model never converges fully."""
UNTRUSTED_RATIO = 2.0
"""Ratio of a fit's cost on data that it did not use to its own cost, above which it is repeated or
dropped."""
SMALL_STEP = 0.01
"""Small change: a trial force as a share of the weight, and the resolution of thresholds in scales."""
SUSPECT_SPREAD = 2.0
"""Prior standard deviation of the parameters of a suspect, in their natural scales about 0."""
CORRELATED = 10.0
"""Number of correlated residuals of a shot that count as one where a model is wrong."""
TERM_PRIOR = 1e-2
"""Prior information on a discovered coefficient, per mean squared residual: ten trial forces are one
deviation."""
FAR_FROM_PRIOR = 2.0
"""Distance beyond which a value contradicts its prior, in standard deviations from the file's value, or in
half widths from the middle of the plausible range, whose ends are uncertain by about that much."""
ABSENT = 1e-3
"""Size of a fitted value, in scales, at or below which an effect counts as absent: below any measurement."""

# Mean squared residuals

CLEAN = 1.35
"""Maximum residual of a model without significant error, in units of the noise.  Of 921 names 908 were right
below it, and 102 of 118 above; a formula is searched above it too."""
RIGHT = 2.0
"""Maximum residual of a model that may be right, in units of the noise or in floors: then likelihood names
effects."""
FIT = 3.0
"""Maximum residual of an acceptable fit, in units of the noise or in floors.  Above it, candidates of a
change also start from several points."""
TUMBLING = 10.0
"""Residual above which the closest fits continue, in floors: no step from the file leads to the values where
the vehicle tumbles."""
FAR_FROM_NOISE = 1000.0
"""Residual above which SHOTS shots carry the information of all, in units of the noise."""

# Candidates of one round

CONTENDERS = 5
"""Number of candidates that are always fitted or tested in one round: it bounds the time."""
MOST_CONTENDERS = 10
"""Maximum number of fits of one round where none is right: one step is a poor score for a candidate that
changes the whole motion or acts in few places."""
CLOSEST = 3
"""Number of the best candidates that are fitted to convergence or reported: it bounds the time."""
HOPELESS = 3.0
"""Ratio to the best error above which a first fit is not refined."""
MOST_FINDINGS = 4
"""Maximum number of effects of one search: it bounds the time."""

# Size of a finding

MATERIAL = 0.05
"""Minimum share of an error, of the noise or of a floor that is worth a finding, a term or a further
search."""
FURTHER = 0.2
"""Minimum share of the present error that a further finding explains, and that findings explain on average
for a search to continue: 0.15 adds two wrong suspects in the frozen table."""
VISIBLE = 0.005
"""Minimum share of the whole squared error, noise included.  A smaller gain is invisible in a replay."""
CHANGED = 0.10
"""Minimum share of the held-out squared residual that a change removes: 0.05 adds two wrong suspects in the
frozen table, 0.15 loses a right name."""
ALMOST_ALL = 0.9
"""Share that counts as almost all: of the error, for names by likelihood above RIGHT; of the shots that stay
finite; of the cost that a refit to the hull forces leaves when it has converged."""
DISTINCT = 4.0
"""Distance from which two models differ, in standard errors: a general effect from its special case, and a
candidate on few shots from the best."""
ALPHA = 0.01
"""Probability of a false alarm in one round, over all effects at once."""
ENTRY_PENALTY = 0.012
"""Penalty of each entry when effects are compared, as a share of the residual.  The hull's error is alike on
all stretches, so held-out data alone do not penalise entries that follow it; 0.004 adds a wrong statement."""
LEAST_ENTRY = 0.004
"""Minimum share of the residual that an entry removes, or else it is dropped, and its penalty where hull laws
are ranked.  With 0.012 a thruster at 60 % in a Stonefish log is estimated at 68 %."""
ABSORPTION_PENALTY = 0.2
"""Penalty of an effect for the hull-force error that it absorbs (`absorbs`), in floors: without it the frozen
table has a second wrong statement."""
NEARLY_EQUAL = 0.7
"""Ratio from which two shares or scores count as nearly equal."""
SIMILAR = 0.5
"""Ratio from which two shares, scores or gains count as of similar size."""
SIMILAR_CURVED = 0.1
"""The same ratio for the linear gain of a nonlinear effect, which shows only a part of what it explains."""
LEAST_EVIDENCE = 10.0
"""Log evidence that gaps of the hull-force library may give: smaller evidence does not rank the names, and
that of a hull law counts only beyond it.  10 or 30 for hull laws names the same in the frozen table."""

# Confidence

SURE = 0.9
"""Minimum confidence of a stated name: one statement in ten may be wrong."""
LIKELY = 0.6
"""Minimum confidence of a name that answers call likely; below it, it is possible."""
MOST_STATED = 0.98
"""Greatest confidence in an answer, which then says "more than 98 %".  All of 339 names with a confidence of
1.000 were right (`benchmarks/results/calibration.csv`): the 95 % interval of their share begins at 98.9 %."""
DOUBTFUL = 0.5
"""Maximum confidence of a name that may stand for another effect: physics excludes its values, or it is named
by transfer although another effect is first or the file has it already."""
RIGHT_ABOVE_CLEAN = 102.0 / 118.0
"""Share of names by likelihood that were right above CLEAN, see `by_likelihood_confidence`."""
TRANSFER_ODDS = -1.76
"""Calibration of names by transfer: log odds at a score of 0, see `by_transfer_confidence`."""
TRANSFER_BY_SCORE = 2.74
"""Calibration of names by transfer: slope of the log odds with respect to the score."""
TRANSFER_BY_LEAD = 2.02
"""Calibration of names by transfer: slope with respect to the relative lead over the next."""
EVIDENCE_BY_LEAD = 1.8
"""Calibration of names by evidence: slope over log(1 + lead), see `by_evidence_confidence`."""
EVIDENCE_EVEN = 1.6
"""Calibration of names by evidence: log(1 + lead) at even odds."""
LEAST_LEAD = 0.15
"""Minimum lead as a share of the evidence; below it the confidence falls in proportion.  Without it, a real
log has a statement that names dead thrusters."""
CHANCE = 0.03
"""Mean lead of the best change by chance, in floors: the part due to the error of the hull model."""
UNKNOWN = 0.3
"""Mean lead by chance for each floor of remaining residual beyond one, which any candidate may explain."""
INEXACT = 0.01
"""Mean lead by chance for each floor that earlier changes removed, due to errors of their formulas: without
it, wrong further names reach a confidence of 0.4."""
STEADY_SECONDS = 20.0
"""Time over which a disturbance is taken as constant under feedback [s]."""
STEADY_CHI2 = 10.0
"""Minimum chi-square per parameter of an effect that remains with steady wrenches, in units of its
expectation."""

# Growth with speed, and discovered terms

SAME_POWER = 0.3
"""Difference of two powers of speed up to which they count as equal: those of known laws differ by 0.5 or
more."""
LEAST_PIECES = 50
"""Minimum number of pieces of a log for the growth with speed: six in each of SPEED_BINS."""
SPEED_BINS = 8
"""Number of speed bins, with equal counts."""
WIDEST_POWER = 1.5
"""Maximum width of a power's 95 % interval for the power to be reported: wider ones do not tell 1 from 2."""
TERM_SHARE = 0.02
"""Minimum share of the error that a kept term removes, or of the variance that a reported term explains."""
TERM_SHORTLIST = 30
"""Number of terms whose transfer is evaluated, ranked by the error that they explain: it bounds the time."""
UNEVEN_WEIGHT = 0.8
"""Weight on the gain of a term that a port-starboard symmetric hull cannot have."""

# Steps of an explanation

MOST_STEPS = 6
"""Maximum number of steps of an explanation, and of terms of a formula: it bounds the time."""
RISE = 1.02
"""Ratio of errors up to which a rise does not matter and a fall is no gain, for a step and for one axis."""
AXIS_LEVEL = 0.05
"""Probability that any axis is called worse by chance (Holm 1979 over the measured axes)."""
LIKELY_STEP = 0.2
"""Confidence from which suspects are tried where nothing is stated: held-out data decide which stay."""
