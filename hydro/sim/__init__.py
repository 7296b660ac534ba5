"""Vehicles in simulation: the MuJoCo model, replays, and the embedded reference simulator."""
