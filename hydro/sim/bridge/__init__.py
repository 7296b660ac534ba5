"""Compiled water forces in MuJoCo: its models, its memory, and the callbacks inside its step."""
