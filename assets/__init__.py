"""Data of the package: the apartment scene, and episodes in it."""
