"""Collision model, inverse kinematics and path planning of the arm."""
