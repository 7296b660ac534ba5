"""Does `hydro diagnose` still name what is missing when sensors and controllers are as they are at sea?

How to run it: `python -m benchmarks.imperfect_logs --help`.
"""
