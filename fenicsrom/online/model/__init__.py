"""The reduced model: its elastic force, loads, pressures, supports and operations."""
