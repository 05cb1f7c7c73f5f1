"""Moving the robot: following paths, holding poses and driving."""
