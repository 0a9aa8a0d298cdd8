"""States, and the check of a step between two stances."""
