"""Waves in a recording: how the water would have to move, and which sea that is."""
