"""Where policies fly and what they may choose: every setting, and ways through the tank."""
