"""Pictures, each of one thing."""
