"""What a recording shows of its own sensors and columns before anything is fitted to it."""
