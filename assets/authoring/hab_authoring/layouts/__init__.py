"""Validation and variation of layouts; not used by running environments."""
