"""Reports of response curves, backbones and paths of equilibria."""
