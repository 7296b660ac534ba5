"""Environment and learner on a GPU: scenes, sonar, rewards and updates (extra `gpu`)."""
