"""Collision checks of the robot with itself and its surroundings, at rest and along motions."""
