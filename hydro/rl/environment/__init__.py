"""Observations, actions, rewards and episodes of a fleet, and its Gymnasium and TorchRL interfaces."""
