"""Plans, and the motion that carries them out."""
