"""Compiled forms, factorisations, eigenmodes and quadrature, which need dolfinx alone."""
