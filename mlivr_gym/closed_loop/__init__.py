"""Walks in which the robot senses what its map lacks, and replans at every grasp."""
