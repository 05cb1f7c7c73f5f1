"""`hab-tasks assets`: a light copy of a dataset, computed once for each content."""
