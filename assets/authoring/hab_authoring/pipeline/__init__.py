"""`hab-tasks assets`: an optimised copy of a dataset, cached by content."""
