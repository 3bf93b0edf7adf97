"""Shapes of sets: bodies that turn, polygons, maps."""
