"""Mutation test of the test suite: change one operator, constant or term, and see whether a test notices.

    make mutants
    python -m benchmarks.mutants --count 200 --seed 0 -o mutants.csv
    python -m benchmarks.mutants -o mutants.csv --again alive      # after new tests

Why not mutmut or cosmic-ray: mutmut wraps every function in a trampoline, which Numba cannot compile.  Both
restart the test command for each mutant: a change of a kernel compiles for a minute, any other change imports
torch and MuJoCo for five seconds.  Neither chooses tests by import.  This package forks a process that holds
the libraries already, keeps the kernels that a change cannot reach (`locator`), and runs the others as Python
(`trial`): most mutants take a few seconds.
"""
