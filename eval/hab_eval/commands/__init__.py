"""Subcommands of `hab-eval`: their options, and their work in modules of their own."""
