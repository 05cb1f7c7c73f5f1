"""Subcommands of `hab-tasks`: one module each, with a dataclass of options and a `run` method."""
