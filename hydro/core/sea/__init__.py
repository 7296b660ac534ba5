"""Detection of waves in a recording from the water motion that would explain its residual forces."""
