"""Scenes from files, tables and overrides, and changed scenes."""
