"""The results site: static pages generated from the submissions."""
