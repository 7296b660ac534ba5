"""How large the errors of a model are, and where they lie."""
