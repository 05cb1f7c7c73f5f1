"""Motion execution: path following and driving."""
