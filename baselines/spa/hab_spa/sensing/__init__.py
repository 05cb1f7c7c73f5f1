"""From depth images to what is seen: points, boxes and octrees."""
