"""Arms, manipulability, base paths and holding."""
