"""The proof of the case study's arm, from its geometry: a road of its own beside that of any robot."""
