"""What is missing, step by step: the ladder of errors, what a step may add, and the loop."""
