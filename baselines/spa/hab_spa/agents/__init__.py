"""Agents for `hab-eval run`."""
