"""Files, shared memory and worker processes."""
