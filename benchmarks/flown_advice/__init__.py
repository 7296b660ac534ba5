"""Test of advised flights: do they identify effects that the first recording could not identify?

Usage: `python -m benchmarks.flown_advice --help`.
"""
