"""Archives of reduced models, and checkpoints of runs."""
