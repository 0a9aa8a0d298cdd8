"""Base poses and branches in which a stance is held."""
