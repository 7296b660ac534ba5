"""Readers of other people's logs, one per format; `registry` chooses by a file's first bytes."""
