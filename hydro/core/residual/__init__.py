"""Models of the residual hull force, which a vehicle file does not explain: regression or network."""
