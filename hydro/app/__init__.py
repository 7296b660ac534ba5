"""Workbench: a local web page that compares a vehicle with a recording, and adds and tunes effects."""
