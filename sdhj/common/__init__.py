"""What every room asks: checks of what users pass, memory, and findings; it imports nothing of the rest."""
