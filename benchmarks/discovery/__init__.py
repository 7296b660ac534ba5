"""Studies of laws outside the catalogue."""
