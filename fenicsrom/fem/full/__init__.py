"""The full model: all unknowns of the mesh, in time and over a period."""
