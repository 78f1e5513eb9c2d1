"""Paths of static equilibria over a load factor."""
