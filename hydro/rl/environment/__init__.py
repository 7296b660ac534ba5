"""Tasks, observations, rewards and the fleet of vehicles that flies them."""
