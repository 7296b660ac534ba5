"""Does the flight that a diagnosis advises tell what the first recording could not?

How to run it: `python -m benchmarks.flown_advice --help`.
"""
