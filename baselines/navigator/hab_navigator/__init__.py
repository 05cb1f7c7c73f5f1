"""Navigate with a map, a learned distribution of the goal pose, and shortest ways.

In the manner of Active Neural SLAM (arXiv 2004.05155): where to go is learned, how to get there is
computed on the robot's own map.
"""
