"""What depends on dolfinx alone: compiled forms, factorisations, eigenmodes and quadrature."""
