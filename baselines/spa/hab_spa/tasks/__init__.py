"""The long tasks: a plan, carried out skill by skill."""
