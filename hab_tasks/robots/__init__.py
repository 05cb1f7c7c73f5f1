"""The Fetch robot with the paper's control, and the snap grasp."""
