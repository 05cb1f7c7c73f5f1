"""Habitat's scene files: datasets, layouts, navigation meshes."""
