"""Periodic motions: the period map, shooting, and the tendency of a march."""
