"""Plans, and the motion that executes them."""
