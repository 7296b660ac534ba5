"""Discovery of sparse force terms outside the catalogue that transfer between regimes of motion."""
