"""Histories of dives: parameters of one vehicle estimated from each dive, and tests for changes over time."""
