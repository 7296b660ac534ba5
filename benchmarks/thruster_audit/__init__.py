"""Does the thruster audit find wrong directions, swapped columns and common scales, and nothing else?

How to run it: `python -m benchmarks.thruster_audit --help`.
"""
