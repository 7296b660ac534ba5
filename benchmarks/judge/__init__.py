"""Scoreboard of the diagnosis: run a stated list of studies, score them, compare two results in pairs.

Usage: `python -m benchmarks.judge --help`.
"""
