"""Gymnasium environments, with their rewards, tasks, observations and wrappers."""
