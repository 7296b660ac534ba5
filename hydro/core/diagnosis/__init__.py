"""Diagnosis: the physical effect that a vehicle file lacks, with a confidence."""
