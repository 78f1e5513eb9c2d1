"""The picture of the set-up."""
