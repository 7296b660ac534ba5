"""Recordings of changed vehicles from a simulator that shares no code with hydro.

Vehicles fly in a simulator of its own, plain numpy and scipy, written from the physics and not from
hydro's catalogue: hulls of sheltering bars, of cross-flow strips whose drag falls with the Reynolds
number, of sections that lift; fins that stall; rigid body and water integrated apart.  No module here
imports hydro; vehicle files are fitted by its command, as a user fits them.

`benchmarks.judge` makes and diagnoses the recordings, in the lists `apart-before` and `apart-plain`.
"""
