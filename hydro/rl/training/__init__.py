"""The learner, its curriculum, and the folder of a training."""
