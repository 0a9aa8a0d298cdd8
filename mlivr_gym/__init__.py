"""Planning and learning for robots that climb hand over hand inside space stations."""
