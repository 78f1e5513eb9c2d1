"""Stresses, deformation and reactions from the coordinates of a reduced model."""
