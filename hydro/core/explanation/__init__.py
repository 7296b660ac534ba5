"""Stepwise completion of a vehicle file: candidates of a step, held-out trials, and the ladder of errors."""
