"""The solid on dolfinx: mesh, elasticity, statics, rotation and the full model."""
