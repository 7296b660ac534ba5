"""Vehicles with hidden effects: which effects a seed hides, and how the vehicle is flown.

`benchmarks.judge` diagnoses the recordings, in the lists `clean-...`.
"""
