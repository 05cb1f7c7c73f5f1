"""Planned skills inside tasks: providers, navigators and hand-over for `hab_plans`."""
