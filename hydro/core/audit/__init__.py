"""Thruster audit: test whether every command column drives its thruster in the direction of the file."""
