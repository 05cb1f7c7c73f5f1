"""The skills, one per file; each is a generator of commands."""
