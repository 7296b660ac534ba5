"""Simulation of a vehicle with its effects: equations of motion, integration, excitation, sensor noise."""
