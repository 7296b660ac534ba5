"""Tasks, sonar, rewards and learning where the vehicles of a GPU fly (extra `gpu`)."""
