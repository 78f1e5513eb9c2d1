"""A run of a model: its set-up, the march and the simulation of a scene."""
