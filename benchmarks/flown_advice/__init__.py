"""Test of whether the flight that a diagnosis advises identifies effects that the first recording could not.

Usage: `python -m benchmarks.flown_advice --help`.
"""
