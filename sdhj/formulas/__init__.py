"""Formulas: a user's NumPy function is read once, as an expression graph, and everything else follows from that."""
