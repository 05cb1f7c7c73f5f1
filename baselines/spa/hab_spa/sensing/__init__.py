"""Perception from depth images: point clouds, boxes, voxels and octrees."""
