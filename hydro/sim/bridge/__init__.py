"""MuJoCo from compiled code: its model, its memory, and the callbacks inside its step."""
