"""Rearrangement tasks: execution of task plans by skills and navigation."""
