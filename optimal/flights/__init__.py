"""What a trajectory is, and what can be certified of it without its solver."""
