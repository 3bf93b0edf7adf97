"""Shapes that sets may be made of: bodies that turn, polygons, maps."""
