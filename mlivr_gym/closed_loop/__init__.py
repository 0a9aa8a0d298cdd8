"""Walks in which the robot senses what its map lacks, turns back and replans."""
