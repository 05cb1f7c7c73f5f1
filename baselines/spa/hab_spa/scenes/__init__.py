"""What a skill knows of the scene: the true state, or what the cameras saw."""
