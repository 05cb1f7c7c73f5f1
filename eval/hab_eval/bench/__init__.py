"""`hab-eval bench`: one file per suite, found by entry point, and shared code."""
