"""The solid: a body in its static equilibrium, and its reactions."""
