"""The tables and keys of a scene: one dataclass for each table."""
