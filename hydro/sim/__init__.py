"""Vehicles in simulation: the MuJoCo student and its replays, and the embedded teacher."""
