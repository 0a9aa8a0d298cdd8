"""What a robot is made of."""
