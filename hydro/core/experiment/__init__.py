"""Recommended experiments: manoeuvres ranked by predicted information, and advice for each finding."""
