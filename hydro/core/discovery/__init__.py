"""Discovery of sparse force terms that no effect of the catalogue describes, tested on held-out data."""
