"""Test of advised flights: whether they identify effects that the first recording could not identify.

Usage: `python -m benchmarks.flown_advice --help`.
"""
