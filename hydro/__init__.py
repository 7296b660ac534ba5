"""hydro: find the missing physics of an underwater vehicle."""
