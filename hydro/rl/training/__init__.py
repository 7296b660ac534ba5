"""Learner, curriculum and folder of a training."""
