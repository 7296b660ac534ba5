"""Readers of log formats, one module each; `registry` selects one by a file's first bytes."""
