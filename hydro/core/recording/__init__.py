"""A recording as arrays, its segments, its smoothed motion and its sensors' faults."""
