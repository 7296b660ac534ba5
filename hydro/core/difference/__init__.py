"""Comparison of two vehicle files: differences in words, and the prediction error that each one causes."""
