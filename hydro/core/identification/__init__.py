"""Parameters of effects from recordings, with standard errors."""
