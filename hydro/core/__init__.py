"""Pure functions on arrays and tables: no files, no clock, no global random state."""
