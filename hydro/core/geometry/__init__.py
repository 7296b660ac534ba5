"""Estimation of a whole vehicle file from the hull's box or mesh, the mass and the thrusters."""
