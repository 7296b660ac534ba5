"""Tests of sensors and columns of a recording before any fit."""
