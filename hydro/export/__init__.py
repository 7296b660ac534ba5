"""Export of vehicles and networks to other programs: one file per target, listed in `export.targets`."""
