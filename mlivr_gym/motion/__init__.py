"""Plans, the committed motion of each step, and trajectories in time."""
