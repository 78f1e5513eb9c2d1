"""Checks between the keys of a scene."""
