"""Quantile of the normal distribution that all intervals share."""

NORMAL_95 = 1.96
"""Half width of a 95 % interval in standard errors."""
