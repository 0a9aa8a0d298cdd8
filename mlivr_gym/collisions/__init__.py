"""Distances between the robot and its world, at rest and along motions."""
