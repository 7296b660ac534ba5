"""Cleaning of a recording before any fit, and a test of whether the recording shows the vehicle at all."""
