"""A vehicle file from what a user knows of a vehicle: its box or mesh, its mass, its thrusters."""
