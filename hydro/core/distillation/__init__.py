"""From recordings to the tables that residual networks learn from."""
