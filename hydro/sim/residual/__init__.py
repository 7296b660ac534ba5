"""Residual network inside the simulation: compiled layers, inputs, and conditioning of the wrench."""
