"""What every room asks; it imports nothing of the rest."""
