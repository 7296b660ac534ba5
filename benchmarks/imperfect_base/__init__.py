"""Does `hydro diagnose` name a change of a vehicle whose hull no formula of the catalogue describes?

How to run it: `python -m benchmarks.imperfect_base --help`.
"""
