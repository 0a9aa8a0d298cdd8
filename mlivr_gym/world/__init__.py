"""Boxes, rails, and maps of graspable points."""
