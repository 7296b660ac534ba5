"""Test of the thruster audit: wrong directions, swapped columns, common scales, and false alarms.

Usage: `python -m benchmarks.thruster_audit --help`.
"""
