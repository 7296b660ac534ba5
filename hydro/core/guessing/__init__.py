"""A first map of a log: what the names of columns suggest, and what their numbers say of it."""
