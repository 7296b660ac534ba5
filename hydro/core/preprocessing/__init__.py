"""Tests for errors of the DVL, from pose and velocity alone, before any model of the dynamics is fitted."""
