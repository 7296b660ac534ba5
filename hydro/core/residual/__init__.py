"""Residual hull force: learned from one recording, held fixed in another."""
