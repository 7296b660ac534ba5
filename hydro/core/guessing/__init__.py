"""Guess of a log's map from the names and values of its columns."""
