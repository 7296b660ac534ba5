"""Vehicles and networks for other programs: one file per target, listed in `export.targets`."""
