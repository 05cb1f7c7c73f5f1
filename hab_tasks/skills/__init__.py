"""Skills: one file each, from start states to the environment; `hab_tasks.engine` runs them."""
