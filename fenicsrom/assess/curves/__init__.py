"""Response curves, backbones and paths of equilibria of a scene, with their errors."""
