"""Answers, figures and HTML pages made from result tables."""
