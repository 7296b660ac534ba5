"""Histories of dives: parameters of one vehicle over time, and tests for changes of them."""
