"""Does `hydro diagnose` name what is missing?  Seeded studies of vehicles with hidden effects.

How to run them: `python -m benchmarks.hidden_effects --help`.
"""
