"""What is known of a vehicle, and the rigid-body physics that follows from it."""
