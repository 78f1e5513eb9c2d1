"""The solid on dolfinx: mesh, elasticity, statics, rotation and the full model.

Imports run one way, between the packages of this one too:

    base < mesh < body < equilibrium < solid < paths < full
"""
