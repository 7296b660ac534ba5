"""Thrust against command and supply voltage, as points of a table, and the published tables that ship."""
