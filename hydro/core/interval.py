"""Width of the intervals that accompany estimates."""

NORMAL_95 = 1.96
"""Half width of a 95 % interval in standard errors."""
