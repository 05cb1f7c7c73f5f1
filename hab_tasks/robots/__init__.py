"""Fetch with the paper's control, and the snap grasp."""
