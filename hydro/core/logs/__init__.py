"""Conversion of log columns to a raw table, and tests of the declared conventions."""
