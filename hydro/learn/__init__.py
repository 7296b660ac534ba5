"""Residual models: networks, their training and their evaluation (torch)."""

from __future__ import annotations

import os

from hydro.core import extras

extras.require("torch")

# Read once, when torch loads: idle OpenMP threads must sleep instead of occupying cores that others need.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
