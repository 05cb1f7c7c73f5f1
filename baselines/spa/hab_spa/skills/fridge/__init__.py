"""The fridge skills: base pose selection, pulls of the door and base maneuvers."""
