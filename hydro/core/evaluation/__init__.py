"""Evaluation: the size of a model's errors, and the conditions in which they occur."""
