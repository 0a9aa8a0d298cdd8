"""Postures of stances: the base pose, and the branches on which each limb may hold."""
