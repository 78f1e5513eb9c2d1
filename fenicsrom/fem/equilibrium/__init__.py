"""Static equilibria of a body and their stability."""
