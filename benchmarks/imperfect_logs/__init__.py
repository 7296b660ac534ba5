"""Logs of vehicles with hidden effects, with the faults of real sensors or recorded under feedback control.

`benchmarks.judge` diagnoses them, in the lists `logs...`.
"""
