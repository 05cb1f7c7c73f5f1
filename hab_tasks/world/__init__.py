"""The world: scenes, their floor, and rays through them."""
