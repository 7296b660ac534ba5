"""Rival methods on the studies of `imperfect_base` and `imperfect_logs`: one script per rival.

Usage: `python -m benchmarks.rivals.output_error --help`, likewise `regression` and `sindy`.
"""
