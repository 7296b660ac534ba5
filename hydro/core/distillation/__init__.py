"""Preparation of training tables for residual networks: labels, features, past velocities and data split."""
