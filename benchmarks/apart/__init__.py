"""Does `hydro diagnose` name what has changed in a world that shares nothing with it?

Vehicles fly in a simulator of its own, plain numpy and scipy, written from the physics and not from
hydro's catalogue: hulls of sheltering bars, of cross-flow strips whose drag falls with the Reynolds
number, of sections that lift; fins that stall; rigid body and water integrated apart.  No module here
imports hydro: it is asked by its command, as a user asks it.

How to run it: `python -m benchmarks.apart --help`.
"""
