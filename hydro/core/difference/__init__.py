"""Differences of two vehicle files, in words and in prediction error."""
