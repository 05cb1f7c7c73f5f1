"""Scene models of the skills: ground truth, or a map from the cameras' images."""
