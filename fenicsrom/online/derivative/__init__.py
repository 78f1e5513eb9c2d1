"""Derivatives of a time step with respect to its start and to parameters."""
