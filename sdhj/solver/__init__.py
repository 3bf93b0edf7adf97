"""Schemes, games, recursion and methods (Sec. 4, App. A.3 to A.5)."""
