"""Perception from depth images: point clouds, boxes and voxels."""
