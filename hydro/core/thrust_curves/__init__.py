"""Thrust curves over command and supply voltage as tables, with published tables."""
