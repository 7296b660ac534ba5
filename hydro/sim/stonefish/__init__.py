"""Stonefish as a simulator: scenario of a vehicle, program, recordings, and a plant."""
