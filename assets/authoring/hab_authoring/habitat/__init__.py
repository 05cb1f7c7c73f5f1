"""Habitat's episode files."""
