"""Figures and pages made from artefacts."""
