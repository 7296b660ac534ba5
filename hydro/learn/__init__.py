"""Residual models: the networks, their training and their evaluation (torch)."""

from __future__ import annotations

import os

# Read once, when torch loads: threads that wait for each other must not keep busy the cores that others need.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
