"""What to compute: scenes read from TOML, checked and completed."""

from fenicsrom.scene.schema import *  # noqa: F403
