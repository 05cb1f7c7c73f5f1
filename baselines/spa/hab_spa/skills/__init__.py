"""The skills, one a file, each a generator of actions."""
