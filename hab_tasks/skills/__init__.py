"""Skills: one file each; `base` runs them."""
