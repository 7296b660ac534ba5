"""Test of the thruster audit: wrong directions, swapped columns, common scales, and false alarms.

How to run it: `python -m benchmarks.thruster_audit --help`.
"""
