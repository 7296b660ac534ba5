"""Cleaned recording used by all commands, and a test of whether it can answer a question."""
