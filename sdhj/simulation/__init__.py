"""Controllers played against adversaries, with the true dynamics and geometry."""
