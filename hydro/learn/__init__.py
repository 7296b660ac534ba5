"""Residual models: the networks, their training and their evaluation (torch)."""
