"""The generator of the `apartment` dataset."""
