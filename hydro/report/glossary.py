"""The words of a report that an engineer may want to look up, in the order in which the page uses them."""

from __future__ import annotations

GLOSSARY = (
    (
        "surge, sway, heave",
        "velocity u, v, w ahead, to starboard and down, along the vehicle's own axes [m/s]",
    ),
    ("roll, pitch, yaw rate", "p, q, r: turning about these axes [rad/s]"),
    ("X Y Z, K M N", "force along these axes [N] and moment about them [N m]"),
    ("error", "root mean square of predicted less measured, over all predictions"),
    (
        "all axes together",
        "errors of every axis as one speed, or force, weighed by the inertia of the first file",
    ),
    ("5 s ahead", "a prediction from the measured motion and the commands alone, 5 s long, begun all along"),
    ("noise alone", "the error that sensor noise and an uncertain beginning would leave of a perfect model"),
    ("unexplained error", "the sum of squared errors beyond what noise alone would leave"),
    (
        "force left over",
        "what acts on the vehicle beyond the file's thrusters, weight, buoyancy, effects and inertia",
    ),
    (
        "blocks",
        "effective number of stretches that a mean rests on; neighbouring rows share their errors",
    ),
    ("held-out data", "a recording to which nothing was fitted"),
    (
        "95 % interval",
        "where the figure would lie in 95 of 100 recordings drawn anew from blocks of this one",
    ),
    ("confidence", "how sure it is that the effect has the right name"),
    ("p-value", "probability of as large a share by chance alone"),
    ("standard error", "how far a fitted value is off by chance, as a standard deviation"),
)
"""Word and meaning."""
