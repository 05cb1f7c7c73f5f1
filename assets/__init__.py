"""Package data: the apartment dataset and its episodes."""
