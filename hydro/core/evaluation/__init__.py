"""Evaluation of a model on a recording: the size of its errors, and the conditions in which they occur."""
