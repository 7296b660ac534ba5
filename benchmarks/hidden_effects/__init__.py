"""Vehicles with hidden effects: the effects that a seed hides, and the flights of the vehicle.

`benchmarks.judge` diagnoses the recordings, in the lists `clean-...`.
"""
