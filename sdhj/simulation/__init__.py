"""Controllers played against adversaries, with the true dynamics and geometry; nothing that solves imports it."""
