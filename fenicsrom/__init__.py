"""Reduced-order models of geometrically nonlinear structures that rub, made from solid meshes on
FEniCSx.
"""
