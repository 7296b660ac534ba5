"""Hidden Effect Challenge: sealed cases, a scorer, baselines and a leaderboard.

`python -m benchmarks.challenge --help`; docs/challenge.md says how to enter.
"""
