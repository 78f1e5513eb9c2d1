"""Modes and critical speeds of rotating bodies."""
