"""Preparation of training tables for residual networks from recordings."""
