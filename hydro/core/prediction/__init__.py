"""Predictions of a recording by a vehicle file, shot by shot, and their derivatives by its parameters."""
