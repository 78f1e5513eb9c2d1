"""Meshes with named groups, from gmsh and from files."""
