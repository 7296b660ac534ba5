"""Reinforcement learning on the student: environments, and policies trained in them."""
