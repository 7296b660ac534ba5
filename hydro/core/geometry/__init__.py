"""Estimation of a vehicle file from box or mesh, mass and thrusters."""
