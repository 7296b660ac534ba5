"""A residual network inside the simulation: compiled layers, their inputs, and the wrench let through."""
