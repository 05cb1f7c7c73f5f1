"""The three long tasks of the Home Assistant Benchmark."""
