"""Scoreboard of the diagnosis: run a stated list of studies, score them, compare two results in pairs.

How to run it: `python -m benchmarks.judge --help`.
"""
