"""Widgets: sliders bound to the pictures of `course.draw`."""
