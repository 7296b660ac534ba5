"""Terms of a report with their meanings, in the order in which the page uses them."""

from __future__ import annotations

GLOSSARY = (
    (
        "surge, sway, heave",
        "velocity u, v, w forward, to starboard and down, in body axes [m/s]",
    ),
    ("roll, pitch, yaw rate", "angular velocity p, q, r about these axes [rad/s]"),
    ("X Y Z, K M N", "force along these axes [N] and moment about them [N m]"),
    ("error", "root mean square difference of predicted and measured values, over all predictions"),
    (
        "all axes together",
        "errors of all axes as one speed or force, weighted by the inertia of the first file",
    ),
    (
        "5 s ahead",
        "prediction of 5 s from the measured state and the commands; predictions start all along the log",
    ),
    ("noise floor", "error of a perfect model, from sensor noise and uncertain initial states"),
    ("unexplained error", "sum of squared errors above the noise floor"),
    (
        "share",
        "part of the unexplained error; shares of several findings need not sum to 100 %; effects that can "
        "replace each other divide theirs",
    ),
    (
        "unexplained force",
        "force that the file's thrusters, weight, buoyancy, effects and inertia do not explain",
    ),
    (
        "blocks",
        "effective number of independent stretches of a mean; errors of neighbouring rows are correlated",
    ),
    ("held-out data", "recording to which nothing was fitted"),
    (
        "95 % interval",
        "range of the figure in 95 of 100 recordings resampled from blocks of this one",
    ),
    (
        "hull-force model",
        "force of the water that the file lacks, fitted to the recording from before the change",
    ),
    ("confidence", "estimated probability that the effect has the right name"),
    ("unconfirmed", "with a confidence below 90 %"),
    ("p-value", "probability that chance alone gives as large a share"),
    ("standard error, ±", "standard deviation of a fitted value due to noise and to errors of the model"),
)
"""Term and meaning."""
