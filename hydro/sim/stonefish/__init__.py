"""Stonefish as a teacher: the scenario of a vehicle, the program that runs it, recordings and a plant."""
