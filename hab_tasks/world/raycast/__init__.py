"""Depth images on the CPU along each pixel's ray, without a renderer or graphics driver."""
